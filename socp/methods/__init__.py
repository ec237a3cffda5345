"""What a method is, and what it is made of: guess, collocated solve, along a word, polish,
digits.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
