"""Headless Chromium for tests of pages and shaders: Debian's, driven by playwright."""

import base64
import contextlib
import json
import shutil
from pathlib import Path

import numpy as np
from playwright.sync_api import sync_playwright

import dsbrdf
from dsbrdf.model.lobes import SHARED
from dsbrdf.view.data import rgb_weights
from dsbrdf.view.page import constants

#: No network, no sandbox inside of containers, WebGL2 and WebGPU in software.
ARGUMENTS = (
    "--no-sandbox",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
    "--enable-unsafe-swiftshader",
    "--enable-unsafe-webgpu",
    "--use-webgpu-adapter=swiftshader",
)

RUN_GLSL = """
([source, inputs, n, nTexels]) => {
    const gl = document.createElement("canvas").getContext("webgl2");
    if (!gl || !gl.getExtension("EXT_color_buffer_float")) throw new Error("no WebGL2 with float targets");
    const compiled = (type, text) => {
        const shader = gl.createShader(type);
        gl.shaderSource(shader, text);
        gl.compileShader(shader);
        if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
        return shader;
    };
    const program = gl.createProgram();
    gl.attachShader(program, compiled(gl.VERTEX_SHADER, `#version 300 es
        void main() {
            gl_Position = vec4(vec2(gl_VertexID % 2, gl_VertexID / 2) * 4.0 - 1.0, 0.0, 1.0);
        }`));
    gl.attachShader(program, compiled(gl.FRAGMENT_SHADER, source));
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    gl.useProgram(program);
    const texture = (width, height, data) => {
        gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
        gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA32F, width, height);
        gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
        gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
        if (data) gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, width, height, gl.RGBA, gl.FLOAT, data);
        return gl.getParameter(gl.TEXTURE_BINDING_2D);
    };
    const width = 1024, height = Math.ceil(n / width);
    const bytes = Uint8Array.from(atob(inputs), c => c.charCodeAt(0));
    const target = texture(width, height, null);
    texture(width * nTexels, height, new Float32Array(bytes.buffer));
    gl.bindFramebuffer(gl.FRAMEBUFFER, gl.createFramebuffer());
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, target, 0);
    gl.viewport(0, 0, width, height);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    const result = new Float32Array(4 * width * height);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.FLOAT, result);
    gl.getExtension("WEBGL_lose_context").loseContext();
    const out = new Uint8Array(result.buffer);
    let text = "";
    for (let i = 0; i < out.length; i += 32768) text += String.fromCharCode(...out.subarray(i, i + 32768));
    return btoa(text);
}
"""


@contextlib.contextmanager
def chromium():
    """A headless browser; `.new_page()` opens a tab.

    Raises
    ------
    FileNotFoundError
        If there is no Chromium on the path.
    """
    path = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if path is None:
        raise FileNotFoundError("no 'chromium' on the path; on Debian: apt-get install chromium")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=ARGUMENTS)
        try:
            yield browser
        finally:
            browser.close()


def watched(page):
    """Errors of a page, a list that grows: what it throws, and errors and warnings it writes to the console."""
    errors = []

    def note(line):
        # Reading pixels back waits for the device, which a test wants
        if line.type in ("error", "warning") and "ReadPixels" not in line.text:
            errors.append(line.text)

    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("console", note)
    return errors


def run_glsl(page, functions, expression, *inputs):
    """Values (n, 4) of a GLSL expression of type vec4, in single precision, for each row of `inputs`.

    Each of `inputs`, (n, up to 4), is there as the vec4 a, b, c, ... of the expression.
    """
    n = len(inputs[0])
    packed = np.zeros((-(-n // 1024) * 1024, len(inputs), 4), dtype="<f4")
    for i, values in enumerate(inputs):
        packed[:n, i, : values.shape[1]] = values
    fetches = "".join(
        f"vec4 {chr(ord('a') + i)} = texelFetch(u_inputs, at + ivec2({i}, 0), 0);\n"
        for i in range(len(inputs))
    )
    source = f"""#version 300 es
        precision highp float;
        precision highp int;
        precision highp sampler2D;
        uniform sampler2D u_inputs;
        out vec4 result;
        {functions}
        void main() {{
            ivec2 at = ivec2(gl_FragCoord.xy) * ivec2({len(inputs)}, 1);
            {fetches}
            result = {expression};
        }}"""
    text = page.evaluate(RUN_GLSL, [source, base64.b64encode(packed.tobytes()).decode(), n, len(inputs)])
    return np.frombuffer(base64.b64decode(text), dtype="<f4").reshape(-1, 4)[:n].astype(float)


RUN_WGSL = """
async ([source, inputs, n, nInputs]) => {
    const adapter = navigator.gpu && (await navigator.gpu.requestAdapter());
    if (!adapter) throw new Error("no WebGPU");
    const device = await adapter.requestDevice();
    const module = device.createShaderModule({ code: source });
    const { messages } = await module.getCompilationInfo();
    if (messages.length) throw new Error(messages.map((m) => `${m.lineNum}: ${m.message}`).join("\\n"));
    const pipeline = await device.createComputePipelineAsync({ layout: "auto", compute: { module } });
    const bytes = Uint8Array.from(atob(inputs), (c) => c.charCodeAt(0));
    const { STORAGE, COPY_DST, COPY_SRC, MAP_READ } = GPUBufferUsage;
    const given = device.createBuffer({ size: bytes.length, usage: STORAGE | COPY_DST });
    device.queue.writeBuffer(given, 0, bytes);
    const made = device.createBuffer({ size: 16 * n, usage: STORAGE | COPY_SRC });
    const read = device.createBuffer({ size: 16 * n, usage: MAP_READ | COPY_DST });
    const encoder = device.createCommandEncoder(), pass = encoder.beginComputePass();
    pass.setPipeline(pipeline);
    pass.setBindGroup(0, device.createBindGroup({
        layout: pipeline.getBindGroupLayout(0),
        entries: [{ binding: 0, resource: { buffer: given } }, { binding: 1, resource: { buffer: made } }],
    }));
    pass.dispatchWorkgroups(Math.ceil(n / 64));
    pass.end();
    encoder.copyBufferToBuffer(made, 0, read, 0, 16 * n);
    device.queue.submit([encoder.finish()]);
    await read.mapAsync(GPUMapMode.READ);
    const out = new Uint8Array(read.getMappedRange());
    let text = "";
    for (let i = 0; i < out.length; i += 32768) text += String.fromCharCode(...out.subarray(i, i + 32768));
    device.destroy();
    return btoa(text);
}
"""


def secure_page(browser):
    """A tab, empty, of an origin that is given WebGPU."""
    page = browser.new_page()
    page.route("https://dsbrdf.test/**", lambda route: route.fulfill(body=BLANK, content_type="text/html"))
    page.goto("https://dsbrdf.test/")
    return page


def run_wgsl(page, functions, expression, *inputs):
    """Values (n, 4) of a WGSL expression of type vec4f for each row of `inputs`; `page` is a `secure_page`."""
    n = len(inputs[0])
    packed = np.zeros((n, len(inputs), 4), dtype="<f4")
    for i, values in enumerate(inputs):
        packed[:, i, : values.shape[1]] = values
    fetches = "".join(
        f"let {chr(ord('a') + i)} = inputs[{len(inputs)}u * at.x + {i}u];\n" for i in range(len(inputs))
    )
    source = f"""{functions}
        @group(0) @binding(0) var<storage, read> inputs: array<vec4f>;
        @group(0) @binding(1) var<storage, read_write> result: array<vec4f>;
        @compute @workgroup_size(64) fn main(@builtin(global_invocation_id) at: vec3u) {{
            if (at.x >= arrayLength(&result)) {{ return; }}
            {fetches}
            result[at.x] = {expression};
        }}"""
    text = page.evaluate(RUN_WGSL, [source, base64.b64encode(packed.tobytes()).decode(), n, len(inputs)])
    return np.frombuffer(base64.b64decode(text), dtype="<f4").reshape(n, 4).astype(float)


ORIGIN = "http://dsbrdf.test"
JAVASCRIPT = Path(dsbrdf.__file__).parent / "view" / "js"
BLANK = (
    "<!doctype html><title>test</title><link rel=icon href='data:,'><body style='margin:0'>"
    f"<script type='application/json' id='meta'>{json.dumps({'constants': constants()})}</script></body>"
)


def open_modules(browser, width=400, height=400, before=None):
    """A tab, nearly empty, in which `import("/sphere.js")` finds the package's modules; `before` runs ahead of all."""
    page = browser.new_page(viewport={"width": width, "height": height})
    if before:
        page.add_init_script(before)

    def answer(route):
        name = route.request.url.removeprefix(f"{ORIGIN}/")
        if name:
            route.fulfill(
                body=(JAVASCRIPT / name).read_text(encoding="utf-8"), content_type="text/javascript"
            )
        else:
            route.fulfill(body=BLANK, content_type="text/html")

    page.route(f"{ORIGIN}/**", answer)
    page.goto(f"{ORIGIN}/")
    return page


def material_json(model):
    """A model as a material of sphere.js, with lists for arrays."""
    names = (*SHARED, "colour")
    arrays = {name: np.asarray(getattr(model.lobes, name)).ravel().tolist() for name in names}
    sizes = {name: getattr(model.lobes, name).shape[-1] for name in names}
    shape = {"nChannels": model.n_channels, "nLobes": model.n_lobes, "sizes": sizes}
    return {
        "name": model.name,
        "rgb": rgb_weights(model.channels)[0].tolist(),
        "profile": None,
        **shape,
        **arrays,
    }
