import threading
from concurrent.futures import ThreadPoolExecutor

from edvo.report.cores import Cores, core_count


def test_counts_at_least_one() -> None:
    assert core_count() >= 1


def test_never_more_at_work_than_cores() -> None:
    cores, lock = Cores(2), threading.Lock()
    at_work = most = 0

    def work(index: int) -> None:
        nonlocal at_work, most
        with cores.tracking() if index == 0 else cores.decoding():
            with lock:
                at_work += 1
                most = max(most, at_work)
            threading.Event().wait(0.002)
            with lock:
                at_work -= 1

    with ThreadPoolExecutor(6) as pool:
        list(pool.map(work, range(24)))
    assert most == 2


def test_tracker_goes_first() -> None:
    cores, order = Cores(1), []
    begun, tracker_waits = threading.Event(), threading.Event()

    def decode_first() -> None:
        with cores.decoding():
            begun.set()
            tracker_waits.wait()
            # Both others queue for the one core by now, or are about to.
            while not cores._tracker_waits:
                pass
            order.append("first decoder")

    def decode_later() -> None:
        tracker_waits.wait()
        with cores.decoding():
            order.append("second decoder")

    def track() -> None:
        begun.wait()
        tracker_waits.set()
        with cores.tracking():
            order.append("tracker")

    threads = [threading.Thread(target=work) for work in (decode_first, decode_later, track)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert order == ["first decoder", "tracker", "second decoder"]


def test_permit_comes_back_after_an_error() -> None:
    cores = Cores(1)
    for _ in range(2):
        try:
            with cores.decoding():
                raise ValueError
        except ValueError:
            pass
    with cores.tracking():
        pass
