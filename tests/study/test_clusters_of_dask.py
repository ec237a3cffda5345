"""A sweep over a cluster of dask: a scheduler and two worker processes, one of them killed."""

import os
import signal
import threading
import time
from typing import Any

import numpy as np
import pytest
from ponds import POND

from socp.errors import MethodError
from socp.study import Sweep, engine, sweep

AT = {"final_time": np.linspace(1.6, 3.1, 16)}


def same(found: Sweep) -> list[dict[str, Any]]:
    return [{k: v for k, v in row.items() if k != "seconds"} for row in found.rows]


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # those of the cluster's own
def test_a_killed_worker_costs_nothing() -> None:
    import distributed

    alone = sweep(POND, AT)
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as two,
        distributed.Client(two) as client,
    ):
        pids = client.run(os.getpid)
        killed = threading.Event()

        def kill() -> None:
            deadline = time.monotonic() + 60
            while not killed.is_set() and time.monotonic() < deadline:
                at_work = {name for name, tasks in client.processing().items() if tasks}
                if len(at_work) == 2:
                    os.kill(pids[min(at_work)], signal.SIGKILL)
                    killed.set()
                time.sleep(0.05)

        thread = threading.Thread(target=kill)
        thread.start()
        found = sweep(POND, AT, workers=client)
        thread.join()
        assert killed.is_set()
        assert set(client.run(os.getpid)) - set(pids), "the worker was begun anew"
    assert found.certified == 16
    assert same(found) == same(alone)


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
def test_a_cluster_is_made_and_ended_and_an_address_is_asked(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with engine("local", 1) as hands:
        assert hands.dashboard.startswith("http")
        found = sweep(POND, {"level": [0.3]}, workers=hands.workers)
    assert found.certified == 1
    monkeypatch.setattr("socp.study.sweeping.engine._PATIENCE", 1)
    with pytest.raises(MethodError, match="no scheduler"), engine("tcp://127.0.0.1:9"):
        pass
