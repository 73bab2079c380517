"""The desktop program with an evaluator of expressions on stdin.

Run with the arguments of `sketchterrain`. Each line of stdin is an expression, evaluated on the GUI thread
with `window` (the main window), `app` and Qt's names; its value is written to stdout as JSON.
"""

import json
import sys
import threading

from PyQt6 import QtCore, QtGui, QtWidgets

from sketchterrain.app.cli import main


class _Evaluator(QtCore.QObject):
    received = QtCore.pyqtSignal(str)

    def __init__(self) -> None:
        super().__init__()
        self.received.connect(self.evaluate, QtCore.Qt.ConnectionType.QueuedConnection)

    def evaluate(self, expression: str) -> None:
        app = QtWidgets.QApplication.instance()
        windows = (each for each in app.topLevelWidgets() if type(each).__name__ == "MainWindow")
        names = {**vars(QtCore), **vars(QtGui), **vars(QtWidgets), "app": app, "window": next(windows, None)}
        try:
            answer = {"value": eval(expression, names)}  # noqa: S307 - written by the test
        except Exception as error:  # noqa: BLE001 - reported to the test
            answer = {"error": f"{type(error).__name__}: {error}"}
        print(json.dumps(answer, default=str), flush=True)  # noqa: T201


def _listen(evaluator: _Evaluator) -> None:
    for line in sys.stdin:
        evaluator.received.emit(line.strip())


if __name__ == "__main__":
    evaluator = _Evaluator()
    threading.Thread(target=_listen, args=(evaluator,), daemon=True).start()
    sys.exit(main(sys.argv[1:]))
