from .balls import flint as flint
from .proving import BITS as BITS
from .proving import Proof as Proof
from .proving import prove as prove
