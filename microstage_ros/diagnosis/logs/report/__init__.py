"""The answer of a log's diagnosis in files: report.json, the page and its pictures, the trend over many logs."""
