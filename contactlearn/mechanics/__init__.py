"""Contact mechanics: the rigid body at a contact, shapes, measured impacts, and the apparatus that measured them."""

from contactlearn.core.lazy import load_when_named

load_when_named(__name__)
