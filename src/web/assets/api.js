// The API of the service, as every other client has it.

const BASE = '/api/v1';

/** The event of a call that was refused because nobody is logged in. */
export const NOBODY = 'gable-nobody';

/** What the service answers when it does not do what it was asked for (RFC 9457). */
export class Problem extends Error {
  constructor(status, body, retryAfter_s) {
    super(body?.detail ?? body?.title ?? `HTTP ${status}`);
    this.status = status;
    this.title = body?.title;
    this.errors = body?.errors ?? [];
    this.id = body?.instance;
    this.body = body;
    /** When it is worth while to ask again, if the service says so. */
    this.retryAfter_s = retryAfter_s;
  }
}

async function request(method, path, { query, body, headers = {}, signal, type } = {}) {
  const address = new URL(BASE + path, location.origin);
  for (const [name, value] of Object.entries(query ?? {})) {
    if (value !== undefined && value !== null && value !== '') address.searchParams.set(name, value);
  }
  const plain = body === undefined || body instanceof Blob || body instanceof FormData || typeof body === 'string';
  const contentType = type ?? (plain ? undefined : 'application/json');
  const response = await fetch(address, {
    method, signal,
    headers: { accept: 'application/json', ...(contentType ? { 'content-type': contentType } : {}), ...headers },
    body: plain ? body : JSON.stringify(body),
  });
  const isJson = (response.headers.get('content-type') ?? '').includes('json');
  const answer = response.status === 204 ? null : isJson ? await response.json() : await response.text();
  // a session that has ended: the frame finds out, and shows the login
  if (response.status === 401 && path !== '/session') dispatchEvent(new Event(NOBODY));
  const wait = Number.parseInt(response.headers.get('retry-after') ?? '', 10);
  if (!response.ok) throw new Problem(response.status, isJson ? answer : { detail: answer }, Number.isNaN(wait) ? undefined : wait);
  return answer;
}

/** Calls by method; `path` begins after `/api/v1`, `options` are `{query, body, headers, signal, type}`. */
export const api = {
  get: (path, options) => request('GET', path, options),
  post: (path, body, options) => request('POST', path, { ...options, body }),
  put: (path, body, options) => request('PUT', path, { ...options, body }),
  delete: (path, options) => request('DELETE', path, options),
  /** The address of what the browser itself loads, such as a picture. */
  address: (path, query = {}) => {
    const parameters = new URLSearchParams(query).toString();
    return BASE + path + (parameters ? `?${parameters}` : '');
  },
};

/** All items of a paged list, page by page, until `most` are there. */
export async function* pages(path, query = {}, { most = Infinity, signal } = {}) {
  let cursor;
  for (let count = 0; count < most;) {
    const page = await api.get(path, { query: { limit: 200, ...query, cursor }, signal });
    yield page.items;
    count += page.items.length;
    cursor = page.next_cursor;
    if (!cursor) return;
  }
}

/**
 * Server-sent events of `path`: `on` maps their names to functions of their data. The browser connects again by itself.
 * Returns a function that ends it.
 */
export function follow(path, on) {
  const source = new EventSource(BASE + path);
  for (const [name, heard] of Object.entries(on)) {
    source.addEventListener(name, (event) => heard(event.data ? JSON.parse(event.data) : null, source));
  }
  return () => source.close();
}
