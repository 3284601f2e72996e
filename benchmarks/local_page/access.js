// A function that gives the faults of a page. See access.py.
() => {
  const faults = [];
  const fault = (rule, element) => faults.push({ rule, what: `${element.tagName.toLowerCase()}#${element.id} ${element.textContent.trim().slice(0, 40)}` });
  const seen = (one) => one.getClientRects().length > 0 && getComputedStyle(one).visibility !== 'hidden';
  const text = (id) => document.getElementById(id)?.textContent.trim() ?? '';
  const name = (one) => (one.getAttribute('aria-label') ?? '').trim()
    || (one.getAttribute('aria-labelledby') ?? '').split(' ').map(text).join(' ').trim()
    || [...(one.labels ?? [])].map((label) => label.textContent.trim()).join(' ')
    || one.getAttribute('alt') || one.getAttribute('title') || one.textContent.trim();
  if (!document.documentElement.lang) fault('page has a language', document.documentElement);
  if (!document.title) fault('page has a title', document.documentElement);
  for (const landmark of ['main', 'header', 'nav']) {
    if (document.querySelectorAll(landmark === 'header' ? 'body > header' : landmark).length !== 1) fault(`one ${landmark}`, document.body);
  }
  for (const one of document.querySelectorAll('button, a[href], input, select, textarea, iframe, [tabindex="0"], [role=region]')) {
    if (seen(one) && !name(one)) fault('control has a name', one);
  }
  for (const one of document.querySelectorAll('img')) if (!one.hasAttribute('alt')) fault('picture has a text', one);
  let level = 1;
  for (const one of document.querySelectorAll('h1, h2, h3, h4')) {
    if (!seen(one)) continue;
    const own = Number(one.tagName[1]);
    if (own > level + 1) fault('headings in order', one);
    level = own;
  }
  const ids = [...document.querySelectorAll('[id]')].map((one) => one.id);
  for (const id of ids) if (ids.indexOf(id) !== ids.lastIndexOf(id)) fault('ids differ', document.getElementById(id));
  const channels = (colour) => (colour.match(/[\d.]+/g) ?? []).map(Number);
  const light = ([r, g, b]) => [r, g, b].map((one) => one / 255).map((one) => (one <= 0.03928 ? one / 12.92 : ((one + 0.055) / 1.055) ** 2.4))
    .reduce((sum, one, index) => sum + one * [0.2126, 0.7152, 0.0722][index], 0);
  const ground = (one) => {
    for (let up = one; up; up = up.parentElement) {
      const own = channels(getComputedStyle(up).backgroundColor);
      if (own.length === 3 || own[3] === 1) return own;
    }
    return [255, 255, 255];
  };
  for (const one of document.querySelectorAll('p, li, h2, h3, button, a, th, td, span, label, summary, strong')) {
    if (!seen(one) || one.closest('.stage, [aria-hidden=true]') || one.disabled || ![...one.childNodes].some((node) => node.nodeType === 3 && node.textContent.trim())) continue;
    const style = getComputedStyle(one);
    const [a, b] = [light(channels(style.color)), light(ground(one))].sort((x, y) => y - x);
    const large = parseFloat(style.fontSize) >= 24 || (parseFloat(style.fontSize) >= 18.66 && Number(style.fontWeight) >= 700);
    if ((a + 0.05) / (b + 0.05) < (large ? 3 : 4.5)) fault(`contrast ${((a + 0.05) / (b + 0.05)).toFixed(2)}`, one);
  }
  for (const one of document.querySelectorAll('button, a[href], .stage, input')) {
    if (!seen(one) || one.disabled) continue;
    const plain = { outline: getComputedStyle(one).outlineStyle, shadow: getComputedStyle(one).boxShadow };
    one.focus({ focusVisible: true, preventScroll: true });
    const style = getComputedStyle(one);
    if (document.activeElement !== one) fault('control takes the focus', one);
    else if (style.outlineStyle === 'none' && style.boxShadow === plain.shadow) fault('focus is visible', one);
    one.blur();
  }
  return faults;
}
