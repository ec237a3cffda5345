"""Which word: read it, mend it, branch over it, or let binaries choose."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
