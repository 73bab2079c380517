"""Stages: pure functions of declared inputs, whose results are cached by digests."""
