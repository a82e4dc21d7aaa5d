import pytest

from grasp3d.viewer import session as sessions


@pytest.fixture(autouse=True)
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Searches begin without a delay."""
    monkeypatch.setattr(sessions, "DELAY", 0.0)
