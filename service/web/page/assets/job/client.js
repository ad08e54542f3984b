// @ts-check
/** Requests to the HTTP API of this server, with the API key if one is set. The key is kept as long as the tab is open. */
import { PROBLEMS } from "../server_texts.js";
import { keep, read } from "../storage.js";
import { TEXTS } from "../texts.js";

const KEY = "key";
const RETRY_MILLISECONDS = 1000;
const ENDED = ["done", "failed", "cancelled"];
const EXPIRED = 410, TOO_LARGE = 413, NO_ROOM = 503;
/** @type {WeakMap<File, string>} The ids of the files that the server keeps. */
const kept = new WeakMap();

/**
 * @typedef {object} Status The status of a job, as described in docs/http.md.
 * @property {string} id
 * @property {"queued" | "running" | "done" | "failed" | "cancelled"} state
 * @property {Progress | null} progress
 * @property {{url: string}} [result]
 * @property {Record<string, any>} [report]
 * @property {{status: number, detail: string}} [problem]
 */
/** @typedef {{stage: string, views_done: number, views: number}} Progress */

/** An error with a message of the page, the server's detail, and the HTTP status, 0 if the server did not answer. */
export class Problem extends Error {
  /**
   * @param {number} status
   * @param {string} [detail]
   */
  constructor(status, detail = "") {
    super(PROBLEMS[status] ?? PROBLEMS[status >= 500 ? 500 : 400]);
    this.status = status;
    this.detail = detail;
  }
}

/**
 * Stores the API key.
 * @param {string} key Empty to forget it. Surrounding white space and invisible characters, as copied from a mail, are removed.
 */
export function setKey(key) {
  keep(KEY, key.replace(/[\p{Cc}\p{Cf}]/gu, "").trim());
}

/**
 * Whether an error means that the user or other work ended the operation.
 * @param {unknown} error
 */
export function isEnded(error) {
  return error instanceof DOMException && error.name === "AbortError";
}

/**
 * Describes an error to the user, with the remedy.
 * @param {unknown} error
 */
export function describeError(error) {
  if (isEnded(error)) return TEXTS.cancelled;
  if (error instanceof Problem) return [error.message, error.detail].filter((text) => text).join(" ");
  return error instanceof Error ? error.message : String(error);
}

/**
 * @typedef {object} Sent A request.
 * @property {string} [method]
 * @property {Record<string, string>} [headers]
 * @property {FormData} [body]
 * @property {AbortSignal} [signal]
 */

/**
 * @param {string} path
 * @param {Sent} [init]
 * @param {(path: string, init: Sent) => Promise<Response>} [send]
 * @returns {Promise<Response>} A successful response.
 * @throws {Problem}
 */
export async function request(path, init = {}, send = fetch) {
  const key = read(KEY);
  const headers = { ...init.headers, ...(key ? { "X-API-Key": encodeHeader(key) } : {}) };
  const response = await send(path, { ...init, headers }).catch((error) => {
    throw isEnded(error) ? error : new Problem(0);
  });
  if (response.ok) return response;
  const problem = await response.json().catch(() => ({}));
  throw new Problem(response.status, typeof problem.detail === "string" ? problem.detail : "");
}

/**
 * Encodes a text for a header of `fetch`, with a character for each byte of its UTF-8: `fetch` refuses characters of more than a byte.
 * @param {string} text
 */
function encodeHeader(text) {
  return String.fromCharCode(...new TextEncoder().encode(text));
}

/**
 * Sends a request as `fetch` does, which can't report how much of the body has been sent.
 * @param {string} path
 * @param {Sent} init
 * @param {(share: number) => void} report Called with the share of the body that has been sent, from 0 to 1.
 * @returns {Promise<Response>}
 */
function send(path, { method = "GET", headers = {}, body, signal }, report) {
  return new Promise((resolve, reject) => {
    signal?.throwIfAborted();
    const sent = new XMLHttpRequest();
    sent.open(method, path);
    for (const [name, value] of Object.entries(headers)) sent.setRequestHeader(name, value);
    sent.upload.onprogress = ({ loaded, total }) => report(loaded / total);
    sent.onload = () => resolve(new Response(sent.response, { status: sent.status }));
    sent.onerror = () => reject(new TypeError());
    sent.onabort = () => reject(signal?.reason);
    const abort = () => sent.abort();
    signal?.addEventListener("abort", abort);
    sent.onloadend = () => signal?.removeEventListener("abort", abort);
    sent.send(body);
  });
}

/**
 * Whether the browser can still read the files of a form: it can't if one has changed since it was chosen.
 * @param {FormData} form
 */
function isReadable(form) {
  const files = [...form.values()].flatMap((value) => (typeof value === "string" ? [] : value));
  return Promise.all(files.map((file) => file.stream().pipeTo(new WritableStream()))).then(
    () => true,
    () => false,
  );
}

/**
 * Posts a form.
 * @param {string} path
 * @param {FormData} form
 * @param {AbortSignal} signal
 * @param {(share: number) => void} [report] Called with the share of the form that has been sent.
 * @returns {Promise<any>} The JSON of the answer.
 */
async function post(path, form, signal, report = () => {}) {
  const init = { method: "POST", body: form, headers: { Prefer: "respond-async" }, signal };
  const sent = request(path, init, (to, prepared) => send(to, prepared, report));
  const response = await sent.catch(async (error) => {
    throw error instanceof Problem && error.status === 0 && !(await isReadable(form)) ? new Error(TEXTS.changed) : error;
  });
  return response.json();
}

/**
 * Sends a file, which the server keeps for several jobs.
 * @param {File} file
 * @param {AbortSignal} signal
 * @param {(share: number) => void} [report]
 * @returns {Promise<string>} Its id.
 */
async function keepFile(file, signal, report) {
  const form = new FormData();
  form.append("file", file);
  const { id } = await post("/v1/files", form, signal, report);
  kept.set(file, id);
  return id;
}

/**
 * Puts a file into a form: its id, once the server keeps it, or the file itself if the server can't keep it.
 * @param {FormData} form
 * @param {File} file
 * @param {AbortSignal} signal
 * @param {(share: number) => void} [report]
 */
async function setFile(form, file, signal, report) {
  try {
    form.set("file_id", kept.get(file) ?? (await keepFile(file, signal, report)));
    form.delete("file");
  } catch (error) {
    const canSend = error instanceof Problem && [TOO_LARGE, NO_ROOM].includes(error.status);
    if (!canSend || /request's body/.test(error.detail)) throw error; // a larger body is refused there too
    form.set("file", file);
    form.delete("file_id");
  }
}

/** A job of the server. */
export class Job {
  /**
   * @param {string} url Its path.
   * @param {Status} status
   */
  constructor(url, status) {
    this.url = url;
    this.status = status;
  }

  /**
   * Posts a job. Its file is only sent if the server does not keep it, or not any more.
   * @param {string} kind The kind of job, such as `reconstructions`.
   * @param {FormData} form
   * @param {AbortSignal} signal
   * @param {(share: number) => void} [report] Called with the share of the file that has been sent.
   */
  static async post(kind, form, signal, report) {
    const path = `/v1/${kind}`, given = form.get("file"), file = given instanceof File ? given : null;
    const send = () => post(path, form, signal, form.has("file") ? report : undefined);
    if (file) await setFile(form, file, signal, report);
    const status = await send().catch(async (error) => {
      if (!(file && error instanceof Problem && error.status === EXPIRED)) throw error;
      kept.delete(file);
      await setFile(form, file, signal, report);
      return send();
    });
    return new Job(`${path}/${status.id}`, status);
  }

  /**
   * Follows the job to its end.
   * @param {(status: Status) => void} report
   * @param {AbortSignal} signal
   * @returns {Promise<Response>} The result, whose body may still be arriving.
   * @throws {Problem}
   */
  async follow(report, signal) {
    let last = "";
    while (!ENDED.includes(this.status.state)) {
      report(this.status);
      try {
        for await (const event of readEvents(`${this.url}/events`, last, signal)) {
          last = event.id;
          if (event.kind === "progress") report({ ...this.status, state: "running", progress: event.data });
        }
      } catch (error) {
        if (!(error instanceof Problem) || ![0, 429, 503].includes(error.status)) throw error;
      }
      this.status = await (await request(this.url, { signal })).json();
      if (!ENDED.includes(this.status.state)) await new Promise((resolve) => setTimeout(resolve, RETRY_MILLISECONDS));
    }
    if (this.status.problem) throw new Problem(this.status.problem.status, this.status.problem.detail);
    if (this.status.state === "cancelled") throw new Problem(409, TEXTS.cancelledElsewhere);
    return request(`${this.url}/result`, { signal });
  }

  /** Cancels the job. */
  async cancel() {
    await request(this.url, { method: "DELETE" });
  }

  /** Cancels the job unless it has ended, as that would remove its result. */
  async cancelRunning() {
    const { state } = await (await request(this.url)).json();
    if (!ENDED.includes(state)) await this.cancel();
  }
}

/**
 * Reads server-sent events (HTML, section 9.2), since `EventSource` can't send a key.
 * @param {string} path
 * @param {string} last The id of the last event that was received.
 * @param {AbortSignal} signal
 */
async function* readEvents(path, last, signal) {
  const { body } = await request(path, { headers: last ? { "Last-Event-ID": last } : {}, signal });
  if (!body) return;
  const reader = body.pipeThrough(new TextDecoderStream()).getReader();
  let text = "";
  for (;;) {
    const { done, value } = await reader.read().catch((error) => {
      throw isEnded(error) ? error : new Problem(0);
    });
    if (done) return;
    const events = (text + value.replaceAll("\r", "")).split("\n\n");
    text = events.pop() ?? "";
    for (const lines of events) {
      const fields = Object.fromEntries(lines.split("\n").map((line) => line.split(/: ?(.*)/s, 2)));
      if (fields.data) yield { id: fields.id ?? "", kind: fields.event, data: JSON.parse(fields.data) };
    }
  }
}
