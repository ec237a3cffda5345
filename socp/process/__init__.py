"""The process around socp: its signals, its standard output, its files, and text from strangers
made safe to show.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
