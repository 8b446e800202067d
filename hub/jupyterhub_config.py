"""A class on one computer: JupyterHub on the teacher's machine or a server of the school.

In the folder above: pip install ".[notebook]" ./lessons jupyterhub jupyterhub-idle-culler; npm install -g
configurable-http-proxy; then, in this folder: jupyterhub -f jupyterhub_config.py
"""

import os
import sys
import tempfile

c = get_config()  # noqa: F821 (JupyterHub defines it)

c.JupyterHub.spawner_class = "simple"  # a folder for each pupil, no account of the system
c.SimpleLocalProcessSpawner.home_dir_template = os.path.join(tempfile.gettempdir(), "class", "{username}")
c.JupyterHub.authenticator_class = "dummy"  # one password for the class; for a hub that others reach, take a real one
c.DummyAuthenticator.password = os.environ["CLASS_PASSWORD"]  # a hub that has none does not start
c.Authenticator.allow_all = True

# The lesson is copied into the pupil's folder at the first start; a copy that is there is kept.
c.Spawner.cmd = ["sh", "-c", f"{sys.executable} -m deformnb lesson coordinates . --copy && exec jupyterhub-singleuser"]
c.Spawner.default_url = "/lab/tree/1a_coordinates_and_grids.ipynb"
c.Spawner.mem_guarantee = "400M"
c.Spawner.mem_limit = "1200M"  # told to kernels; it is enforced by spawners with containers
c.Spawner.start_timeout = 120
c.JupyterHub.active_server_limit = 20

c.JupyterHub.load_roles = [
    {
        "name": "culler",
        "services": ["culler"],
        "scopes": ["list:users", "read:users:activity", "read:servers", "delete:servers"],
    }
]
c.JupyterHub.services = [
    {"name": "culler", "command": [sys.executable, "-m", "jupyterhub_idle_culler", "--timeout=3600"]},
]
