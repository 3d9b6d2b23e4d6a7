"""Tables of results in the forms that people have, read as one metric by method, scene and seed."""
