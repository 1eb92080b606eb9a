"""Buttons, questions and forms of the page, by the words that people read."""
import time

from farm import PATIENCE, Failure


def press_in(page, where, name, words=""):
    """Press the button in `where`, of those the first with these words, whose own words, or whose bold ones, are
    `name`; also if it is drawn anew meanwhile."""
    end = time.monotonic() + 15 * PATIENCE
    while True:
        page.wait("""(() => { const b = [...document.querySelectorAll('%s')].filter(e => e.innerText.includes(%r))
            .flatMap(e => [...e.querySelectorAll('button')]).find(e => e.checkVisibility() &&
            (e.querySelector('b') || e).textContent.trim() === '%s');
            document.getElementById('to-press')?.removeAttribute('id'); if (b) b.id = 'to-press'; return b; })()""" % (
                where, words, name), "a button '%s' in %s" % (name, where))
        try:
            page.click("#to-press", limit_s=1)
            return
        except Failure:
            if time.monotonic() > end:
                raise


def settled(page):
    """Wait until the shown job has stopped changing: its buttons move with its state, and a press may meet another one."""
    page.js("window.sideSeen = ''; window.sideStill = 0; 0")
    page.wait("""(() => { const now = document.querySelector('#side').innerHTML;
        window.sideStill = now === window.sideSeen ? window.sideStill + 1 : 0; window.sideSeen = now;
        return window.sideStill >= 4; })()""", "the job's side to stand still")


def verb(page, name):
    """Press a verb of the shown job: in front, or in the menu behind "More"."""
    page.wait("[...document.querySelectorAll('#side button')].some(b => b.checkVisibility() && "
              "['%s', 'More'].includes(b.textContent.trim()))" % name, "the verb " + name)
    if page.js("[...document.querySelectorAll('#side button')].some(b => b.textContent.trim() === '%s')" % name):
        press_in(page, "#side", name)
    else:
        press_in(page, "#side", "More")
        press_in(page, "[role=menu]", name)


def confirm(page, name):
    """Press a button of the question that is open."""
    press_in(page, "dialog[open]", name)
    page.wait("!document.querySelector('dialog[open] #to-press')", "the question to close")


def field(page, label, value):
    """Fill the field of the open form that has this label."""
    found = page.wait("""(() => { const l = [...document.querySelectorAll('dialog[open] label')].find(e =>
        e.textContent.trim().startsWith(%r)); return l && '#' + l.htmlFor; })()""" % label, "a field " + label)
    if page.js("document.querySelector(%r).tagName" % found) == "SELECT":
        page.choose(found, value)
    else:
        page.type(found, value)
