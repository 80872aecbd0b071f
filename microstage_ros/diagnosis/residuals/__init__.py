"""Residual channels: four balances in which the nominal model and a record can part, each with its own noise."""
