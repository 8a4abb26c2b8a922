"""Names of columns as people write them: our column, and the unit that the name states.

A name is split into words and, at its end, a unit: "vx [mm/s]", "speed_x_after (mm/s)", "ω' (deg/s)", "massKg".  A
column is taken for ours if no other has the same words, and its unit is one that the reader knows.
"""

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from itertools import chain, product
from unicodedata import normalize

from contactlearn.data.cameras import images_of_cameras
from contactlearn.data.table.units import POWERS, UNIT_FACTORS, Units
from contactlearn.mechanics.space import BOTH, PLANE, SPACE, Space

NAMES = ("trial", "object")
"""Columns of names, not numbers."""
OTHERS = ("speed", "height", "direction", "direction_normal", "direction_floor")
"""Other descriptions of a velocity, each also with _post: `descriptions` turns them into components or refuses them."""
VECTORS = tuple(
    f"{vector}{end}"
    for end in ("", "_post")
    for vector in ("position", "quaternion", "quaternion_wxyz", "quaternion_xyzw", "velocity", "spin", "pose", "twist")
)
"""Columns of vectors that settings may name, whose components are ours."""
MOMENTA = {"px": "vx", "py": "vy", "pz": "vz", "momentum": "speed", "angular_momentum": "omega"}
"""Momenta, each also with _post, and the velocities that follow of them and the mass or the moment of inertia."""

_BEFORE = (
    *("pre", "before", "initial", "incoming", "incident", "inbound", "approach", "fall", "release", "minus"),
    *("vor", "vorher", "avant", "chute", "antes", "caída", "caida", "prima", "caduta", "queda"),
    *("lâcher", "lacher", "lâchage", "largage", "loslassen", "suelta", "lanzamiento", "rilascio"),
    *("före", "innan", "før", "voor", "ennen", "przed", "spadku", "před", "до"),
    *("衝突前", "碰撞前", "撞击前", "碰前", "撞前", "前"),
)
_AFTER = (
    *("post", "after", "final", "outgoing", "outbound", "rebound", "reflected", "plus"),
    *("nach", "nachher", "après", "apres", "rebond", "después", "despues", "rebote", "dopo", "rimbalzo", "depois"),
    *("efter", "etter", "na", "jälkeen", "po", "odbicia", "после", "ressalto"),
    *("衝突後", "碰撞后", "碰撞後", "撞击后", "碰后", "撞后", "後", "后"),
)
_IMPACT = (
    *("impact", "contact", "collision", "bounce", "aufprall", "stoß", "stoss", "kontakt"),
    *("choc", "impacto", "choque", "urto", "impatto", "colisão", "stöt", "stöten", "studs", "stød", "støt", "botsing"),
    *("zderzeniem", "zderzeniu", "uderzeniem", "uderzeniu", "nárazem", "nárazu", "törmäystä", "törmäyksen", "удара"),
)
_WORDS = {
    **dict.fromkeys(("velocity", "speed", "vel", "geschwindigkeit", "vitesse", "velocidad", "velocità"), "v"),
    **dict.fromkeys(("hastighet", "hastighed", "snelheid", "velocidade", "prędkość", "rychlost", "nopeus"), "v"),
    **dict.fromkeys(("fart", "скорость", "速度"), "v"),
    **dict.fromkeys(("position", "pos", "pose", "transform", "field"), ""),
    **dict.fromkeys(("of", "the", "dem", "der", "de", "du", "del", "di"), ""),
    **dict.fromkeys(("inerzia", "inercia", "inertie", "inércia"), "inertia"),
    **dict.fromkeys(("masse", "masa", "massa", "hmotnost", "масса", "質量", "质量"), "mass"),
    **dict.fromkeys(("winkel", "ángulo", "angulo", "angolo", "vinkel", "hoek", "ângulo", "kąt", "úhel"), "theta"),
    **dict.fromkeys(("kulma", "угол", "角度"), "theta"),
    **dict.fromkeys(("drehgeschwindigkeit", "winkelgeschwindigkeit", "drehzahl", "drehrate"), "omega"),
    **dict.fromkeys(("vinkelhastighet", "vinkelhastighed", "rotationshastighet", "hoeksnelheid"), "omega"),
    **dict.fromkeys(("rotatiesnelheid", "kulmanopeus", "角速度"), "omega"),
    **dict.fromkeys(("höhe", "hauteur", "altura", "altezza", "höjd", "højde", "høyde", "hoogte"), "height"),
    **dict.fromkeys(("wysokość", "výška", "korkeus", "высота"), "height"),
    **dict.fromkeys(("zeit", "temps", "tiempo", "tempo", "tijd", "czas", "čas", "aika", "время", "時間"), "time"),
    **dict.fromkeys(("instant", "instante", "istante", "zeitpunkt"), "time"),
    **dict.fromkeys(("versuch", "essai", "ensayo", "prova", "försök", "forsøg", "forsøk", "proef"), "trial"),
    **dict.fromkeys(("ensaio", "próba", "pokus", "опыт"), "trial"),
}  # fmt: skip
_COEFFICIENTS = {"en", "cor", "restitution", "restitutioncoefficient", "coefficientrestitution", "coeffrestitution"}
_COEFFICIENTS |= {"e", "ε", "stoßzahl", "restitutionskoeffizient"}
"""Names of a coefficient of restitution along the normal."""
PER_CENT = re.compile(r"[\[(]?\s*(?:%|per ?cent|pct)\s*[\])]?", re.IGNORECASE)
"""A unit of such a coefficient."""
SURFACES = {
    "racket",
    "racquet",
    "paddle",
    "bat",
    "club",
    "clubhead",
    "floor",
    "surface",
    "table",
    "plate",
    "belt",
    "wall",
}
SURFACES |= {"pala", "raqueta", "raquette", "schläger", "racchetta", "raquete"}
SURFACES |= {"ground", "shaker", "platform", "piston", "anvil"}
"""Words for what a body hits, in names of columns."""
MOVING = tuple(f"racket_{velocity}{end}" for velocity in ("vx", "vy", "vz") for end in ("", "_post"))
"""Velocities of what a body hits, as settings name them."""
_BODIES = ("ball", "body", "object", "disc", "disk", "puck", "box", "cube", "sphere", "die",
           "pelota", "balle", "palla", "bola", "boll", "bal", "kugel", "bille")  # fmt: skip
"""Words before or behind the name of a column, where it has one body: ball_vx, v ball."""
_CENTRES = ("c", "cm", "com", "cg", "centre", "center", "centroid", "centro", "mittelpunkt", "schwerpunkt")
"""Words beside the coordinates of frames: xc, x_com, centroid x."""
_FALLS = ("fall", "release", "chute", "caída", "caida", "caduta", "queda", "rebound", "rebond", "rebote", "rimbalzo",
          "lâcher", "lacher", "lâchage", "largage", "suelta", "rilascio")  # fmt: skip
"""Words of the times that say of a length that it is a height: rebound (cm)."""
_NORMAL = ("perp", "perpendicular", "normal", "norm", "n", "normale", "normalna", "normála", "法向", "法線方向",
           "vertical", "verticale", "vertikal", "pionowa", "鉛直", "竖直", "垂直")  # fmt: skip
_ALONG = ("par", "parallel", "para", "tangential", "tangent", "tan", "tang", "t", "along",
          "tangentielle", "tangentiel", "tangenziale", "tangencial", "styczna", "切向", "接線方向",
          "horizontal", "horizontale", "pozioma", "水平")  # fmt: skip
_ACROSS = ("toward", "towards", "into", "against", "off", "from", "awayfrom", "to", "perpendicularto", "normalto")
_ALIASES = {
    "xv": "vx", "xdot": "vx", "yv": "vy", "ydot": "vy", "zv": "vz", "zdot": "vz",
    "angle": "theta", "th": "theta", "phi": "theta", "θ": "theta", "φ": "theta", "orientation": "theta",
    "spin": "omega", "ω": "omega", "w": "omega",
    **dict.fromkeys(("topspin", "spinrate", "rotationv", "rotationalv", "angularrate", "rateofspin"), "omega"),
    **dict.fromkeys(("angularv", "vangular", "vangulaire", "vrotation"), "omega"), "thetadot": "omega",
    "θdot": "omega", "m": "mass", "body": "object", "t": "time",
    **dict.fromkeys(("momentinertia", "momentoinertia", "momentdinertia", "momentodinertia"), "inertia"),
    **dict.fromkeys(("trägheitsmoment", "massenträgheitsmoment", "tröghetsmoment", "traagheidsmoment"), "inertia"),
    **dict.fromkeys(("timestamp", "stamp", "headerstamp", "ts", "xvalue"), "time"),
    **dict.fromkeys(("drop", "take", "toss", "trial", "episode", "episodeindex"), "recording"),
    **{name: f"w{axis}" for axis in "xyz" for name in (
        f"omega{axis}", f"ω{axis}", f"spin{axis}", f"angularv{axis}", f"vangular{axis}"
    )},
    **{name: column for column, words in (("vy", _NORMAL), ("vx", _ALONG)) for word in words
       for name in (f"v{word}", f"{word}v", f"v{word}component", f"{word}component", f"{word}componentv")},
    **{f"v{link}{surface}": column for surface in SURFACES for column, links in (
        ("vy", _ACROSS), ("vx", ("along", "parallelto", "alongside", "on"))) for link in links},
    "v": "speed", **dict.fromkeys(("h", "h0"), "height"), "dropheight": "height", "bounceheight": "height_post",
    "hdrop": "height",
    **dict.fromkeys(("vkątowa", "úhlováv", "угловаяv", "backspin"), "omega"),
    **dict.fromkeys(("l", "lz", "angularmomentum", "momentumangular"), "angular_momentum"),
    **dict.fromkeys(("p", "linearmomentum"), "momentum"),
    **{name: f"p{axis}" for axis in "xyz" for name in (f"momentum{axis}", f"{axis}momentum", f"linearmomentum{axis}")},
    **dict.fromkeys(("impactv", "vimpact", "vi"), "speed"), "impactangle": "direction",
    "incidence": "direction", "angleincidence": "direction", "incidenceangle": "direction",
    **{f"{start}from{reference}": f"direction_{kind}" for start in ("", "incidence", "reflection")
       for kind, references in {"normal": ("normal", "vertical"), "floor": (*SURFACES, "horizontal")}.items()
       for reference in references},
    **{f"{angle}{link}{reference}": f"direction_{kind}"
       for kind, references in {"normal": ("normal", "vertical", "lot"), "floor": (*SURFACES, "horizontal", "platte",
       "boden")}.items() for reference in references for angle in ("angle", "direction", "theta")
       for link in ("", "from", "to", "with", "zum", "zur")},
}  # fmt: skip
_OF_HEIGHT = re.compile(
    r"(?:(?P<before>fall|fald|val|abwurf|loslass)|(?:rück|ab|terug)?(?:prall|sprung|studs|stuit))h(?:öhe|öjd|øjde|øyde|oogte)"
)
"""Words of which one is a height: Fallhöhe, Rückprallhöhe, studshöjd."""
_WITH_UNIT = {
    **dict.fromkeys(("rotation", "rotationrate", "rot", "effet", "lift", "drall", "efecto", "effetto"), "omega"),
    **{"i": "inertia", "tid": "time", "drop": "height", "bounce": "height_post"},
}
"""Words that are no other thing only where the unit says so."""
_LINEAR = ("v", "vel", "velocity", "velocities", "speed", "linear", "linearvelocity", "linvel", "vlin", "vcm",
           "geschwindigkeit", "vitesse", "velocidad", "velocità", "linearvel", "velocitylinear", "vcom")  # fmt: skip
_ANGULAR = ("omega", "ω", "w", "spin", "angular", "angularvelocity", "angvel", "angularvel", "angularrate", "spinrate",
            "velocityangular", "drehgeschwindigkeit", "winkelgeschwindigkeit", "drehrate")  # fmt: skip
_PLACES = ("position", "pos", "p", "x", "com", "cm", "centre", "center", "centreofmass", "centerofmass", "location",
           "translation", "ort", "lage", "posición", "posicion", "posizione")  # fmt: skip
_ROTATIONS = ("orientation", "quaternion", "quat", "q", "rotation", "attitude", "rot", "orientationquaternion", "orn")
_VECTORS: dict[tuple[str, int], tuple[str, ...]] = {
    **{(name, 2): ("vx", "vy") for name in _LINEAR}, **{(name, 3): ("vx", "vy", "vz") for name in _LINEAR},
    **{(name, 1): ("omega",) for name in _ANGULAR}, **{(name, 3): ("wx", "wy", "wz") for name in _ANGULAR},
    **{(name, 2): ("x", "y") for name in _PLACES}, **{(name, 3): ("x", "y", "z") for name in _PLACES},
    **{(name, 4): ("q0", "q1", "q2", "q3") for name in _ROTATIONS},
    **{(name, 2): ("rx", "ry") for name in ("r", "lever", "leverarm")},
    **{(name, 3): ("rx", "ry", "rz") for name in ("r", "lever", "leverarm")},
    **{(name, 3): ("x", "y", "theta") for name in ("pose", "q")}, ("pose", 7): ("x", "y", "z", "q0", "q1", "q2", "q3"),
    **{(name, 6): ("vx", "vy", "vz", "wx", "wy", "wz") for name in ("twist", "velocity", "velocities")},
    ("twist", 3): ("vx", "vy", "omega"),
}  # fmt: skip
"""Components of a vector by the words of its name and their number."""
_ORDERED = {"wxyz": ("qw", "qx", "qy", "qz"), "xyzw": ("qx", "qy", "qz", "qw")}
_INDEXED = ("vx", "vy", "vz", "omega", "wx", "wy", "wz", "speed", "height")
_LETTERED = re.compile(r"(v|ω|w|omega|θ|theta)([xyznt]?)([if])([xyznt]?)")
_UNTIMED = ("mass", "inertia", "trial", "object", "time", "order")
_PLACE = re.compile(r"^(?:p|t|tvec|trans|translation)(?=[xyz]$)")
_QUATERNION = re.compile(r"(?:q|quat|quaternion|orientation|rotation|rot)([wxyz])")
_SPELLED = {
    "per": "", "degree": "deg", "degrees": "deg", "°": "deg", "radian": "rad", "radians": "rad", "sec": "s",
    "second": "s", "seconds": "s", "metre": "m", "metres": "m", "meter": "m", "meters": "m", "inch": "in",
    "inches": "in", "grams": "g", "rpm": "rev.min", "rps": "rev.s", "turn": "rev", "turns": "rev", "revolutions": "rev",
    "kmh": "km.h", "kph": "km.h", "mph": "mi.h", "mile": "mi", "miles": "mi", "lbs": "lb",
    "in": "incoming",  # only [in] and inch are inches
    "grad": "deg", "degré": "deg", "degrés": "deg", "grados": "deg", "gradi": "deg", "fps": "ft.s", "dps": "deg.s",
    "mps": "m.s", "mmps": "mm.s", "cmps": "cm.s", "μm": "um", "μs": "us", "minute": "min", "hr": "h", "hour": "h",
    "degps": "deg.s", "radps": "rad.s", "feet": "ft",
}  # fmt: skip
_REVOLUTIONS: dict[str, str] = dict.fromkeys(
    ("u.min", "upm", "tr.min", "tours.min", "giri.min", "varv.min", "omw.min", "obr.min", "1.min", "min.1"), "rev.min"
)
_REVOLUTIONS |= dict.fromkeys(("u.s", "tr.s"), "rev.s")
"""Whole units of spins, none of which is the unit of anything else."""
_MARKS = (
    (r"(?<=[^\W\d])\s*['′’ʹ´`]", " post "),  # vx'
    (r"(?<=[^\W\d])[_^]*\+(?!\d)", " post "),  # vx+, v_x^+
    (r"(?<=[^\W\d])[_^]*[-−](?=\s*(?:$|[\[(,/]))", " pre "),  # vx-, vx⁻ [m/s]; not s-1 or x-position
    (r"(?<=[\[(/])\s*in\b", "inch"),
)

Stated = Mapping[str, str]
"""Units by quantity, as the name of a column states them."""
Vocabulary = Mapping[str, Mapping[str, Stated]]
"""Units by quantity, by our name of a column and each unit that it may have, written without signs."""


@dataclass(frozen=True, kw_only=True)
class Recognised:
    """Which columns of a file are which.

    Args:
        names: in the file, by ours.
        units: that these names state, by our name.
        others: names of the file that are none of ours.
        doubtful: names of the file with the same meaning, by ours.
    """

    names: Mapping[str, str]
    units: Mapping[str, Stated]
    others: tuple[str, ...]
    doubtful: Mapping[str, tuple[str, ...]]

    def without(self, columns: Collection[str]) -> "Recognised":
        """Return the same but for some of our columns."""
        names, units = (
            {ours: said for ours, said in one.items() if ours not in columns} for one in (self.names, self.units)
        )
        return replace(self, names=names, units=units)

    def stated(self, quantity: str) -> dict[str, list[str]]:
        """Return the units of a quantity that names state, each with the names."""
        found: dict[str, list[str]] = {}
        for column, units in self.units.items():
            if quantity in units:
                found.setdefault(units[quantity], []).append(self.names[column])
        return found


@cache
def impact_vocabulary(space: Space) -> Vocabulary:
    """Return the columns of a table of impacts and their units."""
    columns = (*NAMES, *(column for group in space.components.values() for column in group))
    columns += tuple(f"{column}{end}" for column in (*OTHERS, *MOMENTA) for end in ("", "_post"))
    units: dict[str, dict[str, Stated]] = {column: {"": {}} for column in columns}
    for column in (column for column in columns if column.removesuffix("_post") in POWERS):
        quantities = POWERS[column.removesuffix("_post")]
        for choice in product(*(UNIT_FACTORS[quantity] for quantity in quantities)):
            stated = dict(zip(quantities, choice, strict=True))
            unit = _unit(name_words(f"[{Units(stated).text(column)}]"))
            units[column][unit] = stated
            if stated.get("time", "s") == "s":  # vx_ms, w_rads, I_kgm2
                units[column].setdefault(re.sub(r"\.(?=[^\W\d])", "", unit), stated)
    for column in (f"{momentum}{end}" for momentum in MOMENTA for end in ("", "_post")):
        written = ("n.m.s", "nms", "j.s", "js") if column.startswith("angular") else ("n.s", "ns")
        units[column] |= {unit: {"mass": "kg", "length": "m", "time": "s"} for unit in written}
    return units


_DURATION = re.compile(
    r"zeit$|dauer$|^times?$|duration|temps|durée|tiempo|duración|tempo|durata|czas|tijd|duur|時間|时间"
)
_UNSPACED = re.compile(
    "|".join(sorted((w for w in (*_BEFORE, *_AFTER, *_WORDS) if w > "\u3000"), key=len, reverse=True))
)
"""Words of scripts that have no spaces between them."""


@lru_cache(10_000)  # every reader of a table asks for the same names
def name_words(name: str) -> tuple[str, ...]:
    """Return the words, numbers and signs of degree in a name, in small letters."""
    text = _UNSPACED.sub(r" \g<0> ", normalize("NFKC", name))
    for mark, word in _MARKS:
        text = re.sub(mark, word, text)
    parts = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", text)
    return tuple(re.findall(r"[^\W\d_]+|\d+|°", parts.lower()))


def time_of(name: str) -> str | None:
    """Return "pre" or "post" if a name is that and nothing else, such as "after impact"."""
    words = [word for word in name_words(name) if word not in (*_IMPACT, "the")]
    if not words or not {*words} <= {*_BEFORE, *_AFTER, "in", "out"} or name.strip() == "NA":  # no Dutch "after"
        return None
    return "post" if {*words} & {*_AFTER, "out"} else "pre"


def is_duration(name: str) -> bool:
    """Return whether a name is that of a time or a duration, such as of the darkness of a light gate."""
    words, unit = name_words(name), re.search(r"[\[(]\s*(ms|s|µs|us)\s*[\])]", name)
    return unit is not None and any(_DURATION.search(word) for word in words)


def times_in(name: str, *, opposite: bool) -> str | None:
    """Return "pre" or "post" if a name says that beside other words; with `opposite` in and out are that, too."""
    words = {*name_words(name)}
    if words & {*_AFTER, *(("out",) if opposite else ())}:
        return "post"
    return "pre" if words & {*_BEFORE, *(("in",) if opposite else ())} else None


def components_of(sizes: Mapping[str, int], *, opposite: bool) -> dict[str, tuple[str, ...]]:
    """Return names of the components of vectors by the vectors' names, none where these do not say of what they are.

    Three components of a velocity are those in space only where an orientation or a spin is in space, too.

    Args:
        sizes: number of components of each column.
        opposite: whether in and out are before and after.
    """
    spelled = {**_indexed_vectors(sizes, opposite=opposite), **_contact(sizes)}
    found = {
        name: _components(spelled.get(name, name), size, opposite=opposite)
        or _components(name.rpartition(".")[2], size, opposite=opposite)  # X_WB.translation
        for name, size in sizes.items()
    }
    in_space = any({"q0", "qw", "wx"} & {*names} for names in found.values()) or bool(
        recognise([*sizes], impact_vocabulary(SPACE)).names.keys() & {"qw", "wx"}
    )
    flat = any("z" in name.split(" ")[0].split("_")[0] for names in found.values() for name in names) and not in_space
    if (
        flat
        and "theta" in (*recognise([*sizes], impact_vocabulary(PLANE)).names, *chain.from_iterable(found.values()))
        and not any(one.startswith("omega") for names in found.values() for one in names)
    ):  # velocities of a body in a plane have a spin, and no z
        return {
            name: tuple(f"omega{one[2:]}" if one.startswith("vz") else one for one in names)
            for name, names in found.items()
            if names and (len(names) != len("xyz") or names[-1] in ("vz", "vz_post", "theta"))
        }
    return {name: names for name, names in found.items() if names and not (flat and len(names) == len("xyz"))}


def _indexed_vectors(sizes: Mapping[str, int], *, opposite: bool) -> dict[str, str]:
    """Names of vectors that an index tells apart, as `_indexed` has them, with words for the times."""
    for indices in ("12", "if"):
        found: dict[str, dict[tuple[str, ...], str]] = {index: {} for index in indices}
        for name, size in sizes.items():
            for index, words in _without_index(name, indices):
                if size > 1 and _components(" ".join(words), size, opposite=opposite):
                    found[index][(*words,)] = name
                    break
        before, after = (found[index] for index in indices)
        if before and before.keys() == after.keys():
            said = ((before, "before"), (after, "after"))
            return {name: " ".join((*words, time)) for each, time in said for words, name in each.items()}
    return {}


def _contact(sizes: Mapping[str, int]) -> dict[str, str]:
    """The name of a contact point, with that of its vector from the centre of mass, where no place is known."""
    known = recognise([*sizes], impact_vocabulary(PLANE)).names
    if "x" in known or "rx" in known:
        return {}
    words = {name: name_words(name) for name, size in sizes.items() if size in (2, 3)}
    return {
        name: " ".join(("r", *(word for word in one[1:] if word != "point")))
        for name, one in words.items()
        if one[:1] == ("contact",)
    }


def _components(name: str, size: int, *, opposite: bool) -> tuple[str, ...]:
    """Names of the components of a vector, with its time and unit; none if its name does not say of what it is."""
    time, words = times_in(name, opposite=opposite), name_words(name)
    order = next((word for word in words if word in _ORDERED), None) if size == len("wxyz") else None
    passed_over = {*_BEFORE, *_AFTER, *_IMPACT, *(("in", "out") if opposite else ()), "xy", "xyz", order}
    words = [word for word in words if word not in passed_over]
    while len(words) > 1 and words[0] in (*_BODIES, "base", "pose", "twist", "state", "com", "cm"):
        words = words[1:]
    end = "_post" if time == "post" else ""
    for split in range(len(words), 0, -1):
        names = _VECTORS.get(("".join(words[:split]), size), ())
        names = _ORDERED[order] if order and names and names[0] == "q0" else names
        unit = _unit(words[split:])
        vocabulary = impact_vocabulary(SPACE if {"vz", "wx", "z", "q0"} & {*names} else PLANE)
        if names and all(unit in vocabulary.get(one, {"": {}}) for one in names):
            units = (Units(stated).text(one) if (stated := vocabulary.get(one, {}).get(unit)) else "" for one in names)
            return tuple(f"{one}{end}{f' [{said}]' * bool(said)}" for one, said in zip(names, units, strict=True))
    return ()


def is_unit(text: str) -> bool:
    """Return whether a cell is a unit, such as [mm/s]; "-" is that of a name or a number."""
    word = _unit(name_words(f"[{text.strip().strip('[]()')}]"))
    return text.strip() == "-" or any(word in units for units in impact_vocabulary(PLANE).values() if word)


def unit_as_written(text: str, column: str) -> Stated:
    """Return the unit that a text is of one of our columns, by quantity; none if it is none of it."""
    word = _unit(name_words(f"[{text}]")) if text.strip() else ""
    return next((unit for space in BOTH if (unit := impact_vocabulary(space).get(column, {}).get(word))), {})


def recognise(header: Sequence[str], vocabulary: Vocabulary) -> Recognised:
    """Match each of our columns with the file's column of that name, or with the only other that names it."""
    opposite = any("out" in name_words(name) for name in header)
    matches, timed = dict[str, dict[str, Stated]](), _indexed(header, vocabulary, opposite=opposite)
    for name in header:
        words = timed.get(name) or name_words(name)
        ours, stated = (name, {}) if name in vocabulary else _match(words, vocabulary, opposite=opposite)
        matches.setdefault(ours, {})[name] = stated
    matches.pop("", None)
    names: dict[str, str] = {}
    for ours, candidates in matches.items():
        if ours in candidates or len(candidates) == 1:
            names[ours] = ours if ours in candidates else next(iter(candidates))
    units = {ours: matches[ours][name] for ours, name in names.items() if matches[ours][name]}
    return Recognised(
        names=names,
        units=units,
        others=tuple(name for name in header if name not in names.values()),
        doubtful={ours: tuple(candidates) for ours, candidates in matches.items() if ours not in names},
    )


def is_coefficient(name: str) -> bool:
    """Return whether a name is that of a coefficient of restitution along the normal."""
    return "".join(name_words(PER_CENT.sub("", name))) in _COEFFICIENTS


def are_outcomes(names: Sequence[str]) -> bool:
    """Return whether some names are those of velocities after contact."""
    return any({*space.components["v_post"]} & {*recognise(names, impact_vocabulary(space)).names} for space in BOTH)


def _indexed(header: Sequence[str], vocabulary: Vocabulary, *, opposite: bool) -> dict[str, Sequence[str]]:
    """Words of names that an index tells apart, 1, i or 0 before and 2, f or 1 after, with words for these times.

    Both stand for the same velocities, and no other name says a time: v1 and v2 beside m1 and m2 are of two bodies.
    Where a third has the same words, they are a chain.
    """
    if "vx_post" not in vocabulary or any(times_in(name, opposite=opposite) for name in header):
        return {}
    if len(images_of_cameras(header)) > 1:  # u1, v1, u2, v2 beside times
        return {}
    for indices in ("12", "if", "01"):
        found: dict[str, dict[str, Sequence[str]]] = {index: {} for index in indices}
        ours: dict[str, set[str]] = {index: set() for index in indices}
        for name in header:
            for index, words in _without_index(name, indices):
                if column := _match(words, vocabulary, opposite=opposite)[0]:
                    found[index][name] = [*words, "before" if index == indices[0] else "after"]
                    ours[index].add(column)
                    break
        both = ours[indices[0]] & ours[indices[1]]
        velocities = {column for each in ours.values() for column in each if column in _INDEXED}
        again = {
            _match(words, vocabulary, opposite=opposite)[0] for name in header for _, words in _without_index(name, "3")
        }
        if velocities and velocities <= both and "mass" not in both and not velocities & again:
            return {name: words for each in found.values() for name, words in each.items()}
    return {}


def _without_index(name: str, indices: str) -> Iterator[tuple[str, Sequence[str]]]:
    """The index of a name, a word of it or the second or last letter of its first word, and its other words."""
    words = name_words(name)
    for k, word in enumerate(words[1:3], 1):
        if word in {*indices}:  # and not "12"
            yield word, words[:k] + words[k + 1 :]
    for k in (1, 2):
        letters = _LETTERED.fullmatch("".join(words[:k]))
        if letters and letters[3] in indices:
            yield letters[3], [letters[1] + letters[2] + letters[4], *words[k:]]


def spins_per_second(names: Sequence[str]) -> dict[str, str]:
    """Return names of spins in 1/s, which are radians or revolutions a second, by our column."""
    bare = {_PER_SECOND.sub("[rad/s]", name): name for name in names if _PER_SECOND.search(name)}
    return {
        ours: bare[name] for space in BOTH for ours, name in recognise([*bare], impact_vocabulary(space)).names.items()
    }


_PER_SECOND = re.compile(r"[\[(]\s*(?:1\s*/\s*s(?:ec)?|s(?:ec)?\s*\^?\s*[-−⁻]\s*[1¹]|Hz)\s*[\])]\s*$", re.IGNORECASE)


def unit_in(name: str, column: str, vocabulary: Vocabulary) -> Stated:
    """Return the unit that a name of any words states for one of our columns; none if it states none."""
    words = [word for word in name_words(name) if word not in (*_BEFORE, *_AFTER, *_IMPACT)]
    for split in range(1, len(words)):
        if (unit := _unit(words[split:])) and unit in vocabulary.get(column, {}):
            return vocabulary[column][unit]
    return {}


def _unit(words: Sequence[str]) -> str:
    """A unit without signs, as a vocabulary has it: "mm.s" of mm/s, which is not "m.ms"."""
    whole = ".".join(part for word in words if (part := _SPELLED.get(word, word)))
    return _REVOLUTIONS.get(whole) or re.sub(r"(?<=[sn])\.1$", "", whole)  # of s⁻¹


def _alias(name: str) -> str:
    """Our column of which a name without its unit is another; empty if it is of none."""
    height = _OF_HEIGHT.fullmatch(name)
    return _ALIASES.get(name, "") if height is None else "height" if height["before"] else "height_post"


def _without_symbol(words: Sequence[str]) -> Sequence[str]:
    """Words without a symbol behind them that says the same: drop height h1, angular velocity ω, velocity vx."""
    if words[0] == "v" and "".join(words[1:]) in ("vx", "vy", "vz"):
        return words[1:]
    for split in range(len(words) - 1, 0, -1):
        name, symbol = "".join(words[:split]), "".join(words[split:])
        ours = (_alias(name) or name).removesuffix("_post")
        if ours in (_ALIASES.get(symbol, symbol), _ALIASES.get(symbol.rstrip("012"))):
            return words[:split]
    return words


def _of_centre(words: Sequence[str]) -> str:
    """The coordinate of frames that words are: px, xc, x_com, centroid x; empty if they are none."""
    beside = [word for k, word in enumerate(words) if word not in _CENTRES or (k and word == "cm")]  # x cm has a unit
    bare = _PLACE.sub("", "".join(beside))
    bare = re.sub(r"^c(?=[xyz]$)|(?<=^[xyz])(?:c|cm|com)$", "", bare) if len(words) == 1 else bare
    return bare if bare in ("x", "y", "z") else ""


def _match(words: Sequence[str], vocabulary: Vocabulary, *, opposite: bool) -> tuple[str, Stated]:
    """Our name of a column with these words, and the units that it states; an empty name if none of ours matches.

    Args:
        words: of the name.
        vocabulary: of columns and units.
        opposite: whether other columns are called "out", to which "in" is the opposite.
    """
    before, after = ((*_BEFORE, "in"), (*_AFTER, "out")) if opposite else (_BEFORE, _AFTER)
    ends = ("_post", "") if any(word in after for word in words) else ("",)
    timed = len(ends) > 1 or any(word in before for word in words)
    passed_over, falls = (*before, *after, *_IMPACT) if timed else (), any(word in _FALLS for word in words)
    words = [part for word in words if word not in passed_over and (part := _WORDS.get(word, word))]
    if in_degrees := [word for word in words[:-1] if word in ("deg", "degrees") and "from" in words]:
        words = [*(word for word in words if word not in in_degrees), "deg"]  # incidence deg from normal
    of_impacts = "vx_post" in vocabulary
    if of_impacts and len(words) > 1 and (of_body := next((word for word in words[:2] if word in _BODIES), "")):
        words = [word for word in words if word != of_body]
    if timed and of_impacts and (unit := _unit(words)):  # and nothing else: after [m/s]
        kinds = ("speed", "height") if falls else ("speed",)
        for ours in (f"{kind}{ends[0]}" for kind in kinds if unit in vocabulary[f"{kind}{ends[0]}"]):
            return ours, vocabulary[ours][unit]
    for split in range(len(words), 0, -1):
        name, unit = "".join(_without_symbol(words[:split])), _unit(words[split:])
        place = "" if of_impacts else _of_centre(words[:split])  # px; of impacts it is an impulse
        other = _WITH_UNIT.get(name, "") if unit else ""
        alias = _alias(name).removesuffix("_post" if "_post" in ends else "")  # a rebound height h'
        for ours, end in product((name, alias, other, place, _QUATERNION.sub(r"q\1", name)), ends):
            if unit in vocabulary.get(ours + end, {}) and (end or len(ends) == 1 or ours in _UNTIMED):
                return ours + end, vocabulary[ours + end][unit]
    return "", {}
