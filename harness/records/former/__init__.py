"""Records as earlier versions wrote them, in the form of this one; imports `verdict` and `metric_table` alone."""
