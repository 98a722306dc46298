"""What tests of the web page read off it."""

import base64
import json
import re
import zlib

import numpy as np

#: Run in a page before its own scripts: a browser without WebGL2.
NO_WEBGL = """
const getContext = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
    return kind === "webgl2" ? null : getContext.call(this, kind, ...rest);
};
"""


def part(text, name):
    """Text of a script element."""
    return re.search(rf'<script type="[^"]*" id="{name}">(.*?)</script>', text, re.DOTALL)[1]


def described(text):
    """What the page says of its materials; what many have in common is put into each."""
    content = json.loads(zlib.decompress(base64.b64decode(part(text, "materials"))))
    return [content["kinds"][entry["kind"]] | entry for entry in content["materials"]]


def faults(page):
    """Errors of a page, without what the driver says of the speed of reading pixels."""
    return [error for error in page.errors if "GPU stall" not in error]


def settle(page):
    """Wait for the drawing that follows a change."""
    page.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")


def values_in_page(page, material, theta_h, theta_d, phi_d):
    """Values (n, channel) of a material, or of the model on show, by the page's evaluation."""
    source = "dsbrdf.currentModel()" if material is None else f"dsbrdf.materials[{material}]"
    points = np.stack([theta_h, theta_d, np.cos(2.0 * phi_d)], axis=1).tolist()
    script = (
        f"points => {{ const model = {source}; return points.map(p => [...dsbrdf.evaluate(model, ...p)]); }}"
    )
    return np.array(page.evaluate(script, points))


def curve_on_screen(page, channel):
    """theta_h in degrees and values that the path of a fitted curve stands for, read off against the ticks."""
    path = page.get_attribute(f"#curves-plot path[data-channel='{channel}']", "d")
    points = np.array([[float(x) for x in pair.split()] for pair in re.findall(r"[ML]([\d. -]+)", path)])
    ticks = page.evaluate(
        "[...document.querySelectorAll('#curves-plot .tick')].map(t => "
        "[t.getAttribute('text-anchor'), Number(t.getAttribute('x')), Number(t.getAttribute('y')), t.textContent])"
    )
    across = [(x, float(text)) for anchor, x, _, text in ticks if anchor == "middle"]
    upward = [(y - 4.0, float(text)) for anchor, _, y, text in ticks if anchor == "end"]
    middle = next(x for x, degrees in across if degrees == 0.0)
    right = across[-1]
    root = (points[:, 0] - middle) / (right[0] - middle) * np.sqrt(right[1])
    (y0, v0), (y1, v1) = upward[0], upward[-1]
    return np.sign(root) * root**2, v0 + (points[:, 1] - y0) / (y1 - y0) * (v1 - v0)


def map_state(page):
    """Zoom of the map, who is seen as a sphere, and where all materials are on its canvas."""
    return page.evaluate("dsbrdf.mapState()")


def click_material(page, name, **options):
    """Click a material on the map."""
    settle(page)
    index = page.evaluate("name => dsbrdf.materials.findIndex(m => m.name === name)", name)
    state = map_state(page)
    page.locator("#map-canvas").click(position={"x": state["x"][index], "y": state["y"][index]}, **options)
