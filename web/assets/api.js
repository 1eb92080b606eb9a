/* api: requests to /api/v1. The browser sends the session's cookie. */

export class ApiError extends Error {
  constructor(status, problem) {
    super(problem.detail || problem.title || `the coordinator answered with status ${status}`);
    this.status = status;             /* 0: no answer */
    this.code = problem.code || '';
  }
}

export const base = '/api/v1';

/* The Response, if it is one of success. `signal` of options ends it. */
export async function ask(path, options = {}) {
  let answer;
  try {
    answer = await fetch(base + path, { cache: 'no-store', credentials: 'same-origin', ...options });
  } catch (why) {
    if (why.name === 'AbortError') throw why;
    const asks = !options.method || options.method === 'GET';
    throw new ApiError(0, {
      code: 'no-answer',
      detail: asks ? 'The coordinator does not answer. The page tries again by itself.'
        : 'The coordinator does not answer: it is not known whether this was done. The page does not send it again by itself.',
    });
  }
  if (answer.ok) return answer;
  let problem = {};
  try { problem = await answer.json(); } catch { /* not ours: a proxy's page, say */ }
  throw new ApiError(answer.status, problem);
}

async function value(answer) {
  const text = await answer.text();
  return text && (answer.headers.get('content-type') || '').includes('json') ? JSON.parse(text) : text;
}

const withBody = (method) => async (path, body = {}, options = {}) => value(await ask(path, {
  method, headers: { 'content-type': 'application/json' }, body: JSON.stringify(body), ...options,
}));

export const get = async (path, options) => value(await ask(path, options));
export const post = withBody('POST');
export const del = async (path) => value(await ask(path, { method: 'DELETE' }));
/* Raw bytes: a Blob or a buffer. */
export const put = async (path, bytes, options) => value(await ask(path, {
  method: 'PUT', headers: { 'content-type': 'application/octet-stream' }, body: bytes, ...options,
}));
/* A file's address, for <img> and <a download>. */
export const url = (path) => base + path;
