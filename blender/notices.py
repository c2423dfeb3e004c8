"""What is not modelled, or not as Blender has it: collected with the name of its object, and told once."""


class Notices:
    def __init__(self):
        self._told = {}

    def add(self, who, what):
        """`who`: the kind and the name of what it is about, as "material 'Glass'"."""
        self._told.setdefault((who, what))

    def lines(self):
        return [f"{who}: {what}" for who, what in self._told]

    def __len__(self):
        return len(self._told)
