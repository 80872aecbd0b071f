"""What each friction law can and cannot show, measured by running it."""
