"""Problems and solutions as data: the grammar of expressions, the layout of result files, reading
and writing.
"""
