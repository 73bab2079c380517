"""The desktop program: paint a sketch, view its terrain, edit generated features.

`models` hold the state, `commands` and `painting` change it, all without widgets; `engine` computes and
renders the terrain in processes of its own; `canvas`, `view3d`, `panels` and `dialogs` are the widgets and
`look` their appearance; `window` assembles them and `app` starts the program. Importing this loads no Qt.
"""
