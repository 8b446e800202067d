// The connection to the application in Python.

import type { Session } from "./types.ts";

export const APP_PAGE = Math.random().toString(36).slice(2); // identifies this window among others

/** Calls a procedure of Python. If it fails because the connection was closed, the client shows that by itself. */
export async function callPython(session: Session, method: string, given: unknown[]) {
  await session.call(method, given).catch(() => {});
}
