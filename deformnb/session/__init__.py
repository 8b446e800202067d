"""Session of one person with one volume: edits, undo, autosave, recovery, exports, batch replay."""
