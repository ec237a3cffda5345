"""The language: a problem, a word, a solution and what is found of it, as frozen values."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
