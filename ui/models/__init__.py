"""Models of the window: document, selection, painting, preferences; QtCore only, no widgets."""
