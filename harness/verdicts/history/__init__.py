"""Figures of many runs: when did they change?"""
