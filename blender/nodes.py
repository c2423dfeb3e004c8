"""Follows the links of shader nodes: through groups, reroutes and muted nodes, to a value or a picture.

Works on anything that has the attributes of Blender's nodes, so that it can be tested without Blender.
"""

from math import cos, sin

from .surface import Amount, Texture

#: Whether nodes count whatever their switch says: Blender 5.0 has no such switch, and warns where it is read.
ALWAYS = False


def tree_of(block):
    """The node tree of a material, a world or a light; None where it is not used."""
    return block.node_tree if ALWAYS or getattr(block, "use_nodes", False) else None


_REPEAT, _CLAMP, _MIRROR = 10497, 33071, 33648
_WRAPS = {"REPEAT": _REPEAT, "EXTEND": _CLAMP, "MIRROR": _MIRROR}
_CHANNELS = {"Red": "R", "Green": "G", "Blue": "B", "Alpha": "A", "R": "R", "G": "G", "B": "B"}
_SEPARATE = ("SEPARATE_COLOR", "SEPRGB")


class Graph:
    """A node tree, and what to say where it cannot be followed. `who`: its name in notices."""

    #: Links that are followed at most, so that graphs that branch without end come to one.
    _MOST = 20_000

    def __init__(self, who, notices):
        self.who, self._notices = who, notices
        self._left = self._MOST

    def ended(self, follow, instead, what):
        """What `follow` yields, or `instead`, told as `what`, where the links run in a circle."""
        try:
            return follow()
        except RecursionError:
            self.say(f"the links of its nodes run in a circle; {what}")
            return instead

    def say(self, what):
        self._notices.add(self.who, what)

    def source(self, socket, stack=()):
        """The node and the socket that a socket gets its value from, with the groups around them; None where nothing is linked."""
        while self._left > 0:
            self._left -= 1
            link = next((link for link in socket.links if link.is_valid and not getattr(link, "is_muted", False)), None)
            if link is None:
                return None
            node, origin = link.from_node, link.from_socket
            if node.type == "REROUTE":
                socket = node.inputs[0]
            elif node.type == "GROUP" and node.node_tree:
                outputs = [n for n in node.node_tree.nodes if n.type == "GROUP_OUTPUT"]
                active = next((n for n in outputs if n.is_active_output), outputs[0] if outputs else None)
                inner = _by_identifier(active.inputs, origin.identifier) if active else None
                if inner is None:
                    return None
                socket, stack = inner, stack + (node,)
                if not socket.is_linked:
                    return None, socket, stack
            elif node.type == "GROUP_INPUT" and stack:
                outer = _by_identifier(stack[-1].inputs, origin.identifier)
                if outer is None:
                    return None
                socket, stack = outer, stack[:-1]
                if not socket.is_linked:
                    return None, socket, stack
            elif node.mute:
                inner = [link.from_socket for link in node.internal_links if link.to_socket == origin]
                if not inner:
                    return None
                socket = inner[0]
                if not socket.is_linked:
                    return None, socket, stack
            else:
                return node, origin, stack
        self.say("its nodes have more links than are followed; the rest counts as not linked")
        return None

    def number(self, socket, stack=(), what=None):
        """The plain number of a socket."""
        return float(self._plain(socket, stack, what))

    def colour(self, socket, stack=(), what=None):
        """The plain colour of a socket."""
        value = self._plain(socket, stack, what)
        return tuple(value)[:3] if hasattr(value, "__len__") else (float(value),) * 3

    def _plain(self, socket, stack, what):
        amount = self.amount(socket, stack, what)
        if amount.texture:
            self.say(f"{what or socket.name} comes from a picture, which is not modelled there; {_told(socket)} is used")
            return socket.default_value
        return amount.value

    def base(self, socket, stack=()):
        """The colour of a surface, or the picture or the colours of vertices that give it."""
        found = self.source(socket, stack)
        node = found[0] if found else None
        if node is not None and node.type == "VERTEX_COLOR" and found[1].name == "Color":
            return Amount((1.0, 1.0, 1.0), colours=node.layer_name)
        if node is not None and node.type == "ATTRIBUTE" and found[1].name == "Color" and node.attribute_type == "GEOMETRY":
            return Amount((1.0, 1.0, 1.0), colours=node.attribute_name)
        return self.amount(socket, stack)

    def amount(self, socket, stack=(), what=None):
        """The value of a socket, or the picture that gives it."""
        found = self.source(socket, stack)
        what = what or socket.name
        if found is None:
            return Amount(_value(socket.default_value))
        node, origin, stack = found
        if node is None:
            return Amount(_converted(origin, socket))
        if node.type in ("RGB", "VALUE"):
            return Amount(_converted(node.outputs[0], socket))
        if node.type == "TEX_IMAGE" and node.image:
            return Amount(_value(socket.default_value), self._texture(node, origin, stack))
        if node.type in _SEPARATE and getattr(node, "mode", "RGB") == "RGB":
            inner = self.source(node.inputs[0], stack)
            if inner and inner[0] and inner[0].type == "TEX_IMAGE" and inner[0].image:
                texture = self._texture(inner[0], inner[1], inner[2], _CHANNELS.get(origin.name))
                return Amount(_value(socket.default_value), texture)
        if node.type == "MATH" and all(inner.type == "VALUE" for inner in node.inputs):
            result = self._arithmetic(node, stack)
            if result is not None:
                return Amount((result,) * 3 if isinstance(_value(socket.default_value), tuple) else result)
        self.say(f"{what} comes from the node '{node.name}', which is not modelled; {_told(socket)} is used")
        return Amount(_value(socket.default_value))

    def _arithmetic(self, node, stack):
        """What a node of mathematics gives for plain numbers; None where its inputs are none."""
        numbers = []
        for socket in node.inputs:
            found = self.source(socket, stack)
            if found is not None and found[0] is not None and found[0].type not in ("VALUE", "MATH"):
                return None
            numbers.append(self.amount(socket, stack).value)
        a, b = numbers[0], numbers[1]
        result = {
            "ADD": lambda: a + b,
            "SUBTRACT": lambda: a - b,
            "MULTIPLY": lambda: a * b,
            "DIVIDE": lambda: a / b if b else 0.0,
        }.get(node.operation)
        if result is None:
            return None
        value = result()
        return min(max(value, 0.0), 1.0) if node.use_clamp else value

    def _texture(self, node, origin, stack, channel=None):
        if origin.name == "Alpha":
            channel = "A"
        if node.projection != "FLAT":
            self.say(f"the picture '{node.image.name}' is projected as {node.projection}, and is shown by UV coordinates")
        if node.extension == "CLIP":
            self.say(f"the picture '{node.image.name}' is extended at its sides, and not cut there")
        uv, transform = self._placement(node, stack)
        wrap = _WRAPS.get(node.extension, _CLAMP)
        return Texture(node.image, channel, uv, transform, wrap)

    def _placement(self, node, stack):
        """The UV map of a picture, None for that which renders, and its transform."""
        found = self.source(node.inputs["Vector"], stack)
        transform = None
        if found and found[0] and found[0].type == "MAPPING":
            mapping, _, stack = found
            transform = self._mapping(mapping)
            found = self.source(mapping.inputs["Vector"], stack)
        if found is None:
            return None, transform
        node, origin, _ = found
        if node is not None and node.type == "UVMAP":
            return node.uv_map or None, transform
        if node is not None and node.type == "TEX_COORD" and origin.name == "UV":
            return None, transform
        name = node.name if node is not None else "a plain value"
        self.say(f"a picture is placed by '{name}', which is not modelled; its UV coordinates are used")
        return None, transform

    def _mapping(self, node):
        if any(node.inputs[name].is_linked for name in ("Location", "Rotation", "Scale") if name in node.inputs):
            self.say(f"values of the node '{node.name}' are linked, which is not modelled; its plain ones are used")
        turn = tuple(node.inputs["Rotation"].default_value)
        scale = tuple(node.inputs["Scale"].default_value)
        place = tuple(node.inputs["Location"].default_value) if "Location" in node.inputs else (0.0, 0.0, 0.0)
        if node.vector_type not in ("POINT", "VECTOR"):
            self.say(f"the node '{node.name}' maps as {node.vector_type}, which is not modelled; the picture is not moved")
            return None
        if abs(turn[0]) > 1e-6 or abs(turn[1]) > 1e-6:
            self.say(f"the node '{node.name}' turns around x or y, which is not modelled; only its turn around z is")
        if node.vector_type == "VECTOR":
            place = (0.0, 0.0, 0.0)
        return uv_transform(place, turn[2], scale)

    def normal(self, socket, stack=()):
        """The normal map of a socket and its strength; None without one."""
        found = self.source(socket, stack)
        if found is None or found[0] is None:
            return None, 1.0
        node, _, stack = found
        if node.type == "NORMAL_MAP":
            if node.space != "TANGENT":
                self.say(f"the normal map '{node.name}' is in the space {node.space}, which is not modelled; it is left out")
                return None, 1.0
            amount = self.amount(node.inputs["Color"], stack)
            strength = self.number(node.inputs["Strength"], stack)
            texture = amount.texture
            if texture and node.uv_map and texture.uv is None:
                texture = Texture(texture.image, texture.channel, node.uv_map, texture.transform, texture.wrap)
            return texture, strength
        if node.type == "BUMP":
            self.say(f"the bump map '{node.name}' is not modelled; its surface is smooth")
            return self.normal(node.inputs["Normal"], stack)
        self.say(f"normals come from the node '{node.name}', which is not modelled; they are left as they are")
        return None, 1.0


def uv_transform(place, turn, scale):
    """Offset, rotation and scale of KHR_texture_transform for Blender's mapping of UV coordinates: scaled, turned, moved.

    Blender's v points up and glTF's points down.
    """
    offset = (place[0] - sin(turn) * scale[1], 1.0 - place[1] - cos(turn) * scale[1])
    return (offset, turn, (scale[0], scale[1]))


def _value(value):
    return tuple(value)[:3] if hasattr(value, "__len__") else float(value)


def _converted(origin, socket):
    """The plain value of a socket as another one takes it: a number as grey, a colour by its luminance, a vector by its mean."""
    value, wanted = _value(origin.default_value), _value(socket.default_value)
    if isinstance(wanted, tuple) and not isinstance(value, tuple):
        return (value,) * 3
    if isinstance(value, tuple) and not isinstance(wanted, tuple):
        weights = (0.2126, 0.7152, 0.0722) if origin.type == "RGBA" else (1 / 3,) * 3
        return sum(weight * channel for weight, channel in zip(weights, value))
    return value


def _told(socket):
    value = _value(socket.default_value)
    if isinstance(value, tuple):
        return "the colour " + ", ".join(f"{channel:.3g}" for channel in value)
    return f"{value:.3g}"


def _by_identifier(sockets, identifier):
    return next((socket for socket in sockets if socket.identifier == identifier), None)
