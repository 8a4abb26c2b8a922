"""From recordings of poses to contacts between free flights, with their errors.

track       recordings as read, and tracks in the plane of motion
readers     one small module a format
conventions units, axes, quaternion order: found from free flight, or asked for
flight      robust fits of free flights
detection   free flights of a track
contact     the instant at which two flights meet, and the state there
events      contacts and refusals of a track
rests       bodies at rest
angles      unit and sense of angles: stated or found from the moment balance of the impacts
floor       the floor that contacts and bodies at rest share
result      what was found, as types
"""

TYPE_CHECKING = False
if not TYPE_CHECKING:  # with it a type checker would take any name for one of this room
    from contactlearn.core.lazy import submodules

    __getattr__, __dir__ = submodules(__name__, __path__)
