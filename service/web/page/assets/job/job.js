// @ts-check
/** The work of the page, one thing at a time: the progress of its job, cancelling, errors, and where the time went. */
import { find, make } from "../dom.js";
import { adaptRemedy, STAGES } from "../server_texts.js";
import { SENTENCES, TEXTS } from "../texts.js";
import { isEnded, Problem } from "./client.js";
import { markJob } from "./recent.js";

/** @typedef {import("./client.js").Job} Job */
/** @typedef {import("./client.js").Status} Status */

const panel = find("job", HTMLElement);
const bar = find("progress", HTMLProgressElement);
const text = find("progress-text", HTMLElement);
const problem = find("problem", HTMLElement);
const restart = find("restart", HTMLButtonElement);
const details = find("details", HTMLDetailsElement);

const CANCEL_MILLISECONDS = 5000; // that the next job waits, at most
const LONG = 3000; // milliseconds that a job may still run after it is left: ending it costs the server a new worker process, which takes about as long
const UPLOAD = /(?<!the )\bupload(?:[._][\w.]*\w)?/; // the server's name for a file, with a quilt's layout
const OWN_NOTES = /^tiles\b/; // notes on the format in which the viewer gets views, whatever they show
/**
 * @typedef {object} Place A place for reports.
 * @property {HTMLElement} line The line for the state and the time.
 * @property {HTMLElement} notes The notes below the progress.
 * @property {(problem: HTMLElement) => void} show Puts a problem there.
 */
/** @type {Place} The place around the picture. */
const PICTURE = {
  line: find("status", HTMLElement),
  notes: find("notes", HTMLElement),
  show: (problem) => find("stand", HTMLElement).before(problem),
};
/** @type {Place} The place below the button that begins an export. */
export const EXPORT = {
  line: find("exported", HTMLElement),
  notes: find("export-notes", HTMLElement),
  show: (problem) => find("export-form", HTMLElement).after(problem), // a form can't contain the form for the key
};
const CANCELLED = new DOMException(TEXTS.cancelled, "AbortError");

let work = new AbortController();
/** @type {Job | null} The job of the work, while it runs. */
let job = null;
/** The last request to cancel a job. A job that is begun before this request ends could be the one that it removes. */
let cancelling = Promise.resolve();
let started = 0;
let isOwn = true; // whether the work began its job
let wasDone = false; // whether the job was done before the work requested it
let place = PICTURE; // where the work is reported
let isUnfinished = false;

find("cancel", HTMLButtonElement).addEventListener("click", () => {
  stop(CANCELLED);
  showStatus(TEXTS.cancelled);
});

/**
 * Does work in place of the previous work, and reports how long it took.
 * @template T
 * @param {(signal: AbortSignal) => Promise<T>} action It passes the signal to each job, and checks it after each wait.
 * @param {Place} [reported] Where the work is reported.
 * @returns {Promise<T>} Rejects with an `AbortError` if other work took its place, or the user cancelled it.
 */
export async function perform(action, reported = PICTURE) {
  const isFocused = [problem, restart].some((each) => each.contains(document.activeElement));
  stop();
  hideProblem();
  if (isFocused) find("name", HTMLElement).focus({ preventScroll: true }); // the element that had the focus is hidden
  if (isUnfinished) showStatus(""); // it was ended
  clearExport();
  [place, isUnfinished] = [reported, true];
  place.notes.before(restart, panel);
  work = new AbortController();
  const { signal } = work;
  const begun = performance.now();
  wasDone = false;
  const result = await action(signal);
  signal.throwIfAborted();
  isUnfinished = false;
  showStatus(SENTENCES.done(SENTENCES.time(performance.now() - begun), wasDone));
  return result;
}

/**
 * Ends the work in the page, and its job on the server once that has run for long.
 * @param {DOMException} [reason]
 */
export function stop(reason) {
  work.abort(reason);
  const left = job, isAsked = reason === CANCELLED, rest = LONG - (performance.now() - started);
  job = null;
  if (left && (isAsked || rest <= 0)) cancel(left.cancel());
  else if (left && isOwn) setTimeout(() => endLeft(left), rest);
  panel.hidden = restart.hidden = true;
}

/**
 * Ends a job that was left and still runs, unless the work has returned to it.
 * @param {Job} left
 */
function endLeft(left) {
  const isBeginning = job === null && !panel.hidden; // a job that may be the same
  if (isBeginning) setTimeout(() => endLeft(left), LONG);
  else if (job?.url !== left.url) cancel(left.cancelRunning());
}

/** @param {Promise<void>} answer The answer to a request that cancels a job. */
function cancel(answer) {
  const ended = Promise.all([cancelling, answer.catch(() => {})]); // it may have ended by itself
  cancelling = Promise.race([ended, new Promise((resolve) => setTimeout(resolve, CANCEL_MILLISECONDS))]).then(() => {});
}

/** Ends the work and clears its reports. */
export function clear() {
  stop();
  PICTURE.line.textContent = "";
  hideProblem();
  clearNotes();
  clearExport();
  details.hidden = true;
}

/** Clears the notes on the picture. */
export function clearNotes() {
  PICTURE.notes.replaceChildren();
}

/** Clears the reports of the last export. */
function clearExport() {
  EXPORT.line.textContent = "";
  EXPORT.notes.replaceChildren();
}

/** Clears the reports of the last export when another is chosen, unless it is still being made. */
export function leaveExport() {
  if (place === EXPORT && !panel.hidden) return;
  clearExport();
  if (place !== EXPORT) return;
  hideProblem();
  restart.hidden = true;
}

/** @param {string} message A message that screen readers read too. */
export function showStatus(message) {
  place.line.textContent = message;
}

/**
 * Runs a job of the work to its end, and records its state in the list of recent jobs.
 * @param {(report: (share: number) => void) => Promise<Job>} start Reports the share of the input that has been sent.
 * @param {string} name The name of its result.
 * @param {AbortSignal} signal The signal of the work.
 * @param {boolean} [isNew] Whether `start` begins the job.
 * @returns {Promise<{job: Job, response: Response}>}
 */
export async function run(start, name, signal, isNew = true) {
  signal.throwIfAborted();
  showStatus(name);
  panel.hidden = false;
  let begun = (started = performance.now());
  isOwn = isNew;
  /** @type {Job | undefined} */
  let mine;
  const report = (/** @type {Status | null} */ status) => {
    if (mine && status?.state === "running") markJob(mine.url, status.state);
    showProgress(status, begun);
  };
  report(null);
  try {
    await cancelling;
    signal.throwIfAborted();
    mine = await start(showSent);
    begun = started = performance.now(); // sending took a time of its own
    signal.throwIfAborted();
    job = mine;
    wasDone = mine.status.state === "done";
    const response = await mine.follow(report, signal);
    signal.throwIfAborted();
    return { job: mine, response };
  } finally {
    // A job that existed before and is left soon goes on.
    const isLeft = signal.aborted && signal.reason !== CANCELLED && !isNew && performance.now() - begun < LONG;
    if (mine && !isLeft) markJob(mine.url, signal.aborted ? "cancelled" : mine.status.state);
    if (!signal.aborted) {
      job = null;
      panel.hidden = true;
    }
  }
}

/** @param {number} share The share of the input that has been sent. */
function showSent(share) {
  [bar.max, bar.value] = [1, share];
  text.textContent = SENTENCES.sent(share);
}

/**
 * @param {Status | null} status null until the job has begun.
 * @param {number} begun The start time in milliseconds.
 */
function showProgress(status, begun) {
  const { stage, views_done: done, views } = status?.progress ?? { stage: "", views_done: 0, views: 0 };
  if (views > 1) bar.max = views;
  if (views > 1) bar.value = done;
  else bar.removeAttribute("value");
  const left = done ? ((performance.now() - begun) * (views - done)) / done / 1000 : 0;
  const parts = [status?.state === "queued" ? TEXTS.queued : (STAGES[stage] ?? TEXTS.reading)];
  const isOfViews = job?.url.startsWith("/v1/reconstructions/"); // other jobs also count rows of pixels, and planes
  if (views > 1) parts.push(isOfViews ? SENTENCES.views(done, views) : SENTENCES.share(done / views));
  if (left) parts.push(SENTENCES.left(left));
  text.textContent = parts.join(", ");
}

/**
 * Shows an error and its remedy; after Cancel, a button to start again.
 * @param {unknown} error
 * @param {string} name The name of the open input.
 * @param {() => void} retry
 */
export function showProblem(error, name, retry) {
  if (isEnded(error)) {
    restart.hidden = work.signal.reason !== CANCELLED;
    restart.onclick = retry;
    if (!restart.hidden) restart.focus(); // in place of Cancel
    return;
  }
  const message = error instanceof Error ? error.message : String(error);
  const { status, detail } = error instanceof Problem ? error : { status: -1, detail: "" };
  showStatus("");
  find("problem-text", HTMLElement).textContent = message;
  find("problem-detail", HTMLElement).textContent = adaptRemedy(detail).replace(UPLOAD, () => name);
  find("key-form", HTMLFormElement).hidden = status !== 401;
  const again = find("retry", HTMLButtonElement);
  again.hidden = status === 401 || (status >= 400 && status < 500 && ![404, 408, 409, 410, 429].includes(status));
  again.onclick = retry;
  const isSeen = EXPORT.line.closest("form")?.getClientRects().length; // not if no file is open
  (isSeen ? place : PICTURE).show(problem);
  problem.hidden = false;
  problem.scrollIntoView({ block: "nearest" });
  if (status === 401) find("key", HTMLInputElement).focus();
  const fields = document.querySelectorAll(`form [name="${CSS.escape(/^\w+/.exec(detail)?.[0] ?? "")}"]`); // of exports last
  [...fields].at(place === EXPORT ? -1 : 0)?.setAttribute("aria-invalid", "true");
}

/** Hides the error. */
function hideProblem() {
  problem.hidden = true;
  for (const field of document.querySelectorAll("[aria-invalid]")) field.removeAttribute("aria-invalid");
}

/**
 * Shows the report of a job: its notes in addition to those that are shown, and where the time for a picture went.
 * @param {Status} status
 */
export function showReport(status) {
  const { timings_ms: timings = {}, plan, notes } = status.report ?? {};
  /** @type {string[]} */
  const found = (notes ?? []).map((/** @type {unknown} */ note) => adaptRemedy(String(note)));
  const shownNotes = [PICTURE, EXPORT].flatMap(({ notes }) => [...notes.children].map((note) => note.textContent));
  const added = [...new Set(found)].filter((note) => !OWN_NOTES.test(note) && !shownNotes.includes(note));
  place.notes.append(...added.map((note) => make("p", note)));
  if (place === EXPORT) return;
  const shown = Object.entries(timings).filter(([stage]) => stage in STAGES);
  const stages = shown.map(([stage, time]) => {
    const share = make("i", "", { class: `stage-${stage}` });
    share.style.flexGrow = String(time);
    return share;
  });
  find("stages", HTMLElement).replaceChildren(...stages);
  find("times", HTMLElement).replaceChildren(
    ...shown.map(([stage, time]) =>
      make("li", [make("i", "", { class: `stage-${stage}` }), make("span", `${STAGES[stage]} ${SENTENCES.time(Number(time))}`)]),
    ),
  );
  const remarks = [...found, ...(plan?.reasons ?? [])].map((remark) => make("li", String(remark)));
  find("remarks", HTMLElement).replaceChildren(...remarks);
  details.hidden = false;
}
