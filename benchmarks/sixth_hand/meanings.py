"""Which words of what remains are right for unknown physics: the author's truth, beside every table.

The author said of each which coefficient it acts on, and on what it depends.  Where the contact is known at an angle,
r_x follows θ, so that one is as right as the other; so is v_x where it is the slip v_t, and v_y where it is v_n.  No
name of the catalogue does as well as the right one in the author's comparison, but for other words for the same.
"""

from fifth_hand.meanings import Right

RESTITUTION, FRICTION, OTHER = "eps", "mu", None
ANGLE, SLIP, SPEED = ("theta", "rx"), ("vt", "vx"), ("vn", "vy")

UNKNOWN: dict[str, Right] = {
    "electret stripes": Right(OTHER, (*ANGLE, "x", *SPEED)),
    "slug in a slot": Right(OTHER, (*ANGLE, *SLIP, *SPEED, "omega")),
    "hinged flap": Right(RESTITUTION, (*ANGLE, "omega")),
    # It acts on the moment.
    "second corner": Right(OTHER, (*ANGLE, "omega", *SPEED)),
    "corrugated floor": Right(OTHER, ("x", *SLIP, *SPEED)),
    "travelling wave in the floor": Right(OTHER, (*SPEED, "x")),
    "mode of a slotted ring": Right(RESTITUTION, (*ANGLE, *SPEED)),
    "Magnus lift": Right(OTHER, ("omega", *SLIP, *SPEED)),
    "directional dry adhesive": Right(OTHER, (*ANGLE, *SLIP)),
    "seams of the ball": Right(OTHER, (*ANGLE, *SLIP, *SPEED, "omega")),
    "wedge of damping putty": Right(RESTITUTION, (*SPEED, "x")),
    "electroadhesive fingers": Right(FRICTION, ("x", *ANGLE)),
    "tether goes taut": Right(OTHER, ("x", *SLIP, "omega")),
    "immersed in a liquid": Right(OTHER, (*ANGLE, *SLIP, *SPEED, "omega")),
    "cocked plunger": Right(OTHER, (*ANGLE, *SLIP, *SPEED)),
    "leaning bristles": Right(OTHER, ("x", *SLIP)),
    "room thermostat": Right(RESTITUTION, ("order",), follows=("order", "period"), period=41),
    "film that recovers in the pauses": Right(FRICTION, ("order",), follows=("order",)),
    "slow foam": Right(RESTITUTION, ("x",), follows=("place",)),
    "wear that heals": Right(FRICTION, ("x",), follows=("place", "slip_speed")),
    "contact charging": Right(OTHER, ("order",), follows=("order", "slip_speed")),
    # The normal impulse of an impact follows its speed, as it does in `fourth_hand.meanings`.
    "floor still swinging": Right(OTHER, (), follows=("normal_speed", "normal_impulse")),
}
