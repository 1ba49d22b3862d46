"""Web sockets that wait for the service as long as the tests do."""

from functools import partial

from patience import PATIENCE_S
from websockets.sync import client

connect = partial(client.connect, open_timeout=PATIENCE_S)
