"""Scores of pictures: the metrics, a learner against the test views, and pictures that other programs rendered."""
