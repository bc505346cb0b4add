"""Contracts of plug-ins: properties that each registered generator, encoder and metric must have."""
