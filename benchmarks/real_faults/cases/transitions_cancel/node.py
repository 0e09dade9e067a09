"""Drives to the stations of orders, one at a time; a stop ends the drive under way."""

import asyncio

from transitions.extensions.asyncio import AsyncMachine


class Cart:
    def __init__(self, publish):
        self.publish, self.there, self.station, self.drive = publish, asyncio.Event(), None, None
        moves = [["go", "parked", "driving"], ["park", "driving", "parked"]]
        self.machine = AsyncMachine(self, ["parked", "driving"], "parked", moves, queued=True, auto_transitions=False)

    async def on_enter_driving(self):
        self.publish("mode", {"mode": "driving", "station": self.station})
        await self.there.wait()
        await self.park()

    async def on_enter_parked(self):
        self.publish("mode", {"mode": "parked", "station": self.station})

    async def handle(self, topic, m):
        under_way = self.drive is not None and not self.drive.done()
        if topic == "order" and not under_way:
            self.station = m["station"]
            self.there.clear()
            self.drive = asyncio.create_task(self.go())
        elif topic == "tag" and m["station"] == self.station and m["range"] < 0.5:
            self.there.set()
        elif topic == "stop" and under_way:
            self.drive.cancel()
            await asyncio.wait([self.drive])
            await self.park()
        for _ in range(50):  # the drive goes on as far as it can
            await asyncio.sleep(0)


def node(publish, checked):
    cart, loop = Cart(publish), asyncio.new_event_loop()
    return {topic: lambda m, t=topic: loop.run_until_complete(cart.handle(t, m)) for topic in ("order", "tag", "stop")}
