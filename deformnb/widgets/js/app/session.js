// The connection to the application in Python.

/** @import { Session } from "./types.d.ts" */

export const APP_PAGE = Math.random().toString(36).slice(2); // identifies this window among others

/**
 * Calls a procedure of Python. One that fails because the connection has gone is no news: the page says so by itself.
 * @param {Session} session
 * @param {string} method
 * @param {unknown[]} given
 * @param {() => void} failed
 */
export function callPython(session, method, given, failed = () => {}) { session.call(method, given).catch(failed); }
