"""What a person works on: the document, what is chosen and shown. QtCore for signals, no widgets."""
