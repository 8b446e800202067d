"""One person's work on one volume: edits, undo, autosave, recovery, exports, batch replay."""
