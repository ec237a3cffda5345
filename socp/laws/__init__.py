"""What Pontryagin's principle says on an arc: control laws, their orders, and which modes there
are.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
