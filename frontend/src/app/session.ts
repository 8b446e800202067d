// The connection to the application in Python.

/** @import { Session } from "./types.d.ts" */

export const APP_PAGE = Math.random().toString(36).slice(2); // identifies this window among others

/**
 * Calls a procedure of Python. If it fails because the connection has gone, the page shows that by itself.
 * @param {Session} session
 * @param {string} method
 * @param {unknown[]} given
 */
export async function callPython(session, method, given) { await session.call(method, given).catch(() => {}); }
