from kaju import MaterialAgent, State


class TrafficLight(MaterialAgent):
    """Red in every third generation: then it passes nothing on."""

    stopped = State(0, "times it was red")

    def emissions(self, load):
        if self.model.generation % 3 == 0:
            self.stopped += 1
            return ()
        return super().emissions(load)
