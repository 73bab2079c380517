"""The desktop program as a person starts it, besides answering questions about its window on stdin.

Run with the arguments of `sketchterrain`. Each line of stdin is an expression, worked out on the window's
thread with `window` (the main window), `app` and Qt's names; its value goes to stdout as JSON.
"""

import json
import sys
import threading

from PyQt6 import QtCore, QtGui, QtWidgets

from sketchterrain.app.cli import main


class _Answers(QtCore.QObject):
    asked = QtCore.pyqtSignal(str)

    def __init__(self) -> None:
        super().__init__()
        self.asked.connect(self.answer, QtCore.Qt.ConnectionType.QueuedConnection)

    def answer(self, question: str) -> None:
        app = QtWidgets.QApplication.instance()
        windows = (each for each in app.topLevelWidgets() if type(each).__name__ == "MainWindow")
        names = {**vars(QtCore), **vars(QtGui), **vars(QtWidgets), "app": app, "window": next(windows, None)}
        try:
            told = {"value": eval(question, names)}  # noqa: S307 - the test asks
        except Exception as error:  # noqa: BLE001 - the test is told
            told = {"error": f"{type(error).__name__}: {error}"}
        print(json.dumps(told, default=str), flush=True)  # noqa: T201


def _listen(answers: _Answers) -> None:
    for line in sys.stdin:
        answers.asked.emit(line.strip())


if __name__ == "__main__":
    answers = _Answers()
    threading.Thread(target=_listen, args=(answers,), daemon=True).start()
    sys.exit(main(sys.argv[1:]))
