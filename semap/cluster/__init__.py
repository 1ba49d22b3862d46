"""A PostgreSQL server of semap's own: found, initialised, started and shared by the processes of one user.

`lease` is the way in. `Cluster` is the server itself and takes no locks.
"""

from semap.cluster.cluster import Cluster
from semap.cluster.home import default_home
from semap.cluster.lease import keep_running, lease, stop_keeping

__all__ = ["Cluster", "default_home", "keep_running", "lease", "stop_keeping"]
