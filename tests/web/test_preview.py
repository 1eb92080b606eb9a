#!/usr/bin/env python3
"""A look at a scene before it is submitted: what the form shows, what it costs the farm, and that nothing of it stays."""
import base64
import json
import os
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from browser import Browser  # noqa: E402
from farm import Tests, wait_for  # noqa: E402
from jobs import expect  # noqa: E402
from webfarm import WebFarm, connected  # noqa: E402

tests = Tests()
LOOK = "form.submit .primary + button"
WORDS = ".preview figcaption"
SHOWN = "/a first look/.test(document.querySelector('%s')?.textContent)" % WORDS
# The mean of what the picture shows, 0 to 255.
MEAN = """(() => { const image = document.querySelector('.preview img'), c = new OffscreenCanvas(image.naturalWidth, image.naturalHeight).getContext('2d');
    c.drawImage(image, 0, 0);
    const { data } = c.getImageData(0, 0, image.naturalWidth, image.naturalHeight);
    return data.reduce((sum, x, i) => i % 4 < 3 ? sum + x : sum, 0) / (data.length / 4 * 3); })()"""


def scene_of_two_files(farm):
    """Its buffer is a file of its own; a picture that it names is missing."""
    with open(farm.scene()) as file:
        scene = json.load(file)
    scene["images"] = [{"uri": "wood.png"}]
    scene["textures"] = [{"source": 0}]
    scene["materials"][0]["pbrMetallicRoughness"]["metallicRoughnessTexture"] = {"index": 0}
    scene["buffers"][0]["uri"], data = "room.bin", scene["buffers"][0]["uri"]
    with open(farm.path("room.gltf"), "w") as file:
        json.dump(scene, file)
    with open(farm.path("room.bin"), "wb") as file:
        file.write(base64.b64decode(data.split(",")[1]))
    return farm.path("room.gltf"), farm.path("room.bin")


def form(page, farm, *paths):
    page.open(farm.origin() + "/#/submit")
    page.give_files("#pick-files", paths or [farm.scene()])
    page.wait("document.querySelector('#scene option')", "the scene")


def sent(page, word="/files/"):
    """What was asked for with this method, or below this path."""
    page.settle()
    return [r["url"].rsplit("/api/v1", 1)[1] for r in page.requests if r["method"] in ("PUT", "POST") and word in r["url"]]


def jobs(farm):
    return farm.api("GET", "/jobs?filter=all")["jobs"]


def names(farm):
    return [j["name"] for j in jobs(farm)]


def uploads(farm):
    return [f for f in os.listdir(os.path.join(farm.store, "imports")) if f != "trash"]


@tests.add
def a_look():
    """the picture is small, in the file's proportions, and follows the form; its jobs go; the files are sent once, and then submitted"""
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator()
        farm.start_worker()
        page = farm.page(browser)
        form(page, farm, *scene_of_two_files(farm))
        page.type("[name=size]", "640x480")
        page.type("[name=frames]", "3-5")
        page.click(LOOK)
        page.wait(SHOWN, "the picture")
        image = page.js("(({naturalWidth, naturalHeight}) => [naturalWidth, naturalHeight])(document.querySelector('.preview img'))")
        expect(image == [320, 240], image)
        page.wait_text("Frame 3", WORDS)
        page.wait_text("wood.png", ".preview ul")
        dark = page.js(MEAN)
        expect(dark > 5, "a black picture: %g" % dark)
        wait_for(lambda: not jobs(farm), "the preview's job to go")
        expect(len(sent(page)) == 2 and len(uploads(farm)) == 1, "%s %s" % (sent(page), uploads(farm)))

        page.type("[name=exposure]", "1.5")
        page.wait_text("From before a change", WORDS)
        page.click(LOOK)
        page.wait(SHOWN, "another picture")
        light = page.js(MEAN)
        expect(light > 1.2 * dark, "%g, and %g with more exposure" % (dark, light))

        page.type("[name=spp]", "2")
        page.click("form.submit .primary")
        page.wait("location.hash.startsWith('#/job/')", "the job")
        number = int(page.js("location.hash").rsplit("/", 1)[1])
        expect([j["job"] for j in jobs(farm)] == [number], names(farm))
        job = farm.job(number)
        expect((job["name"], job["settings"]["width"], job["settings"]["spp"], job["last_frame"], job["priority"]) == ("room", 640, 2, 5, 0), job)
        expect(job["output"]["denoise"] == "off" and job["output"]["exposure_ev"] == 1.5, job["output"])
        expect(len(sent(page)) == 2, "sent again: %s" % sent(page))
        wait_for(lambda: not uploads(farm), "the upload to go")


@tests.add
def nothing_stays():
    """a preview that waits says so, and its job goes: when the scene is submitted, when the form is left, and when the page is closed"""
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator()
        page = farm.page(browser, role="submit", width=390, height=844, phone=True)
        form(page, farm)
        page.click(LOOK)
        page.wait_text("The preview waits", WORDS)
        place = page.js("(({top, bottom}) => [top, bottom, innerHeight])(document.querySelector('.preview').getBoundingClientRect())")
        expect(0 <= place[0] and place[1] <= place[2], "the picture is not in view: %s" % place)
        page.size(1280, 1000)
        expect([(j["name"], j["priority"]) for j in jobs(farm)] == [("tiny (preview)", 100)], names(farm))
        page.type("[name=size]", "32x24")
        page.click(LOOK)  # the one before is of no use any more
        wait_for(lambda: [j["settings"]["width"] for j in jobs(farm)] == [32], "one preview")
        page.wait_text("The preview waits", WORDS)
        page.click("form.submit .primary")
        page.wait("location.hash.startsWith('#/job/')", "the job")
        wait_for(lambda: names(farm) == ["tiny"], "the preview's job to go")
        form(page, farm)
        page.click(LOOK)
        page.wait_text("The preview waits", WORDS)
        page.js("location.hash = '#/workers'")
        wait_for(lambda: names(farm) == ["tiny"], "the preview's job to go")
        form(page, farm)
        page.click(LOOK)
        page.wait_text("The preview waits", WORDS)
        expect(len(uploads(farm)) == 1, uploads(farm))
        page.close()
        wait_for(lambda: sorted(j["state"] for j in jobs(farm)) == ["cancelled", "queued"], "the preview's job to end")
        wait_for(lambda: not uploads(farm), "the upload to go")


@tests.add
def what_is_wrong():
    """a scene that cannot be read says why, and the missing file alone is sent then; an upload that is gone is sent again"""
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator()
        farm.start_worker()
        page = farm.page(browser)
        page.allow("422|404|503|ERR_CONNECTION|ERR_EMPTY|WebSocket|502|ERR_FAILED")
        scene, data = scene_of_two_files(farm)
        form(page, farm, scene)
        page.click(LOOK)
        page.wait_text("room.bin", "form.submit .problem")
        expect(not jobs(farm), names(farm))
        page.give_files("#pick-files", [data])
        page.wait_text("2 files", "form.submit .drop")
        page.click(LOOK)
        page.wait(SHOWN, "the picture")
        expect([s.rsplit("/", 1)[1] for s in sent(page)] == ["room.gltf", "room.bin"], sent(page))
        wait_for(lambda: not jobs(farm), "the preview's job to go")
        with open(data, "ab") as file:
            file.write(b"more")  # what is shown would be of a file that there is no more
        page.click(LOOK)
        page.wait_text("room.bin changed since it was chosen: choose it again", "form.submit .problem")
        page.give_files("#pick-files", [data])
        page.wait("!document.querySelector('form.submit .problem').textContent", "the words to go")
        farm.coordinator.kill()
        farm.restart_coordinator()
        connected(page)
        expect(not uploads(farm), uploads(farm))
        page.click("form.submit .primary")
        page.wait("location.hash.startsWith('#/job/')", "the job")
        expect([s.rsplit("/", 1)[1] for s in sent(page)][-2:] == ["room.gltf", "room.bin"] and names(farm) == ["room"], "%s %s" % (sent(page), names(farm)))


if __name__ == "__main__":
    tests.run()
