// What the page asks its own server; an error is its sentence.

export class Refused extends Error {
  constructor(message, stale) {
    super(message);
    this.stale = stale;
  }
}

async function answer(response) {
  const text = await response.text();
  let content = null;
  try { content = JSON.parse(text); } catch { /* plain text */ }
  if (!response.ok) {
    throw new Refused(content?.error ?? text.trim() ?? "the server cannot be reached", response.status === 409);
  }
  return content;
}

export async function ask(path, values = {}) {
  const query = new URLSearchParams(values).toString();
  return answer(await fetch(query ? `${path}?${query}` : path));
}

// A file as it is.
export async function upload(path, file) {
  return answer(await fetch(path, { method: "POST", headers: { "content-type": "application/octet-stream" }, body: file }));
}

export async function send(path, content = {}) {
  const body = JSON.stringify(content);
  return answer(await fetch(path, { method: "POST", headers: { "content-type": "application/json" }, body }));
}
