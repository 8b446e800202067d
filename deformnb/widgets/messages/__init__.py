"""Messages between the widgets and their front ends: one typed record for each, which is its only description.

Most of a widget's state is synced traits. Messages are what must arrive in order, once, or with binary data. A record
checks what arrives, is what senders construct, and is written out as a TypeScript type and as a row of
``docs/messages.md`` (:mod:`deformnb.widgets.generate`).
"""
