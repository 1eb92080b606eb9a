/* memory: what the browser keeps for this page. One that keeps nothing (cookies and site data refused, a full disk) must not
 * keep the page from working: then it is as on the first visit, until it is closed.
 */
function memory(name) {
  const here = new Map();
  let store = null;
  try { store = window[name]; } catch { /* refused */ }
  return {
    get(key) { try { return store.getItem(key) ?? here.get(key) ?? null; } catch { return here.get(key) ?? null; } },
    set(key, value) { here.set(key, value); try { store.setItem(key, value); } catch { /* for now, then */ } },
    remove(key) { here.delete(key); try { store.removeItem(key); } catch { /* there is none */ } },
  };
}
export const kept = memory('localStorage');
export const keptByTab = memory('sessionStorage');
