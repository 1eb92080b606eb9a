"""Buttons, questions and forms of the page, by the words that people read."""
import itertools
import time

from farm import PATIENCE, Failure


PRESSES = itertools.count(1)


def press_in(page, where, name, words="", limit_s=15):
    """Press the button in `where`, of those the first with these words, whose own words, or whose bold ones, are
    `name`; also if it is drawn anew meanwhile. Returns the mark that it carries now.

    Each press has a mark of its own: the page keeps buttons that it does not show, and shows them again."""
    end = time.monotonic() + limit_s * PATIENCE
    while True:
        mark = "press%d" % next(PRESSES)
        page.wait("""(() => { const b = [...document.querySelectorAll('%s')].filter(e => e.innerText.includes(%r))
            .flatMap(e => [...e.querySelectorAll('button')]).find(e => e.checkVisibility() &&
            (e.querySelector('b') || e).textContent.trim() === '%s');
            if (b) b.dataset.press = '%s'; return b; })()""" % (
                where, words, name, mark), "a button '%s' in %s" % (name, where), limit_s)
        try:
            page.click("[data-press=%s]" % mark, limit_s=1)
            return mark
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
    """Press a verb of the shown job: in front, or in the menu behind "More".

    Which of the two changes with the job's state, and a menu may have been opened for the state before: both are looked
    for until the press is done."""
    front = ("[...document.querySelectorAll('#side button')].find(b => "
             "b.checkVisibility() && b.textContent.trim() === '%s')")
    item = ("[...document.querySelectorAll('[role=menu] button')].find(b => "
            "b.querySelector('b').textContent.trim() === '%s')" % name)
    end = time.monotonic() + 15 * PATIENCE
    while True:
        try:
            if page.js("!!" + item):
                press_in(page, "[role=menu]", name, limit_s=1)
                return
            if page.js("!!" + front % name):
                press_in(page, "#side", name, limit_s=1)
                return
            if page.js("!!" + front % "More"):
                press_in(page, "#side", "More", limit_s=1)
                page.wait("!!" + item, "'%s' in the menu" % name, 2)
        except Failure:
            if time.monotonic() > end:
                raise
        if time.monotonic() > end:
            raise Failure("no verb '%s'" % name)
        page.frames(1)


def confirm(page, name):
    """Press a button of the question that is open."""
    mark = press_in(page, "dialog[open]", name)
    page.wait("!document.querySelector('dialog[open] [data-press=%s]')" % mark, "the question to close")


def field(page, label, value):
    """Fill the field of the open form that has this label."""
    found = page.wait("""(() => { const l = [...document.querySelectorAll('dialog[open] label')].find(e =>
        e.textContent.trim().startsWith(%r)); return l && '#' + l.htmlFor; })()""" % label, "a field " + label)
    if page.js("document.querySelector(%r).tagName" % found) == "SELECT":
        page.choose(found, value)
    else:
        page.type(found, value)
