"""Posed images as other trainers write and read them."""
