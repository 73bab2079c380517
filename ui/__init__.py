"""The desktop program: paint a sketch, see its terrain, change what was generated.

`models` hold what a person works on, `commands` change it and `painting` draws into it, all without
widgets; `engine` works out and draws the terrain in processes of its own; `canvas`, `view3d`, `panels` and
`dialogs` show it, `look` says how; `window` puts them together and `app` starts it. Importing this loads no
Qt.
"""
