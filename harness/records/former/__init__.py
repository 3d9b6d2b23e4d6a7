"""Converts records of earlier versions to the form of this one; imports only `verdict` and `metric_table`."""
