"""What is proved in ball arithmetic: that an extremal exists, and what no control can do better."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
