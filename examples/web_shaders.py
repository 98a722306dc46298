"""A material as code: a shader for Shadertoy, and a page with three.js.

    python examples/web_shaders.py [MODEL.json] [FOLDER]

Writes to FOLDER, the current one by default, shadertoy.glsl, to be pasted into a new shader at shadertoy.com, and
three.html, which opens in a browser and loads three.js from a public server. Without a model it fits a built-in
material. Both light a sphere by three lamps.
"""

import sys
from pathlib import Path

import dsbrdf
from dsbrdf import shader

LIGHTING = """
// Radiance toward the viewer of a point of a surface under three lamps and a weak sky; all in one frame
vec3 lit(vec3 normal, vec3 view) {
    vec3 across = normalize(cross(abs(normal.y) < 0.9 ? vec3(0.0, 1.0, 0.0) : vec3(1.0, 0.0, 0.0), normal));
    mat3 to_local = transpose(mat3(across, cross(normal, across), normal));
    vec3 lamps[3] = vec3[3](vec3(-0.5, 0.6, 0.7), vec3(0.8, 0.2, 0.5), vec3(0.3, 0.7, -0.6));
    vec3 power = vec3(2.5, 1.0, 1.5);
    vec3 wo = to_local * view, light = vec3(0.0);
    for (int i = 0; i < 3; ++i) {
        vec3 wi = to_local * normalize(lamps[i]);
        light += power[i] * max(wi.z, 0.0) * dsbrdf_eval(wi, wo);
    }
    // The sky by samples of the material itself
    for (int i = 0; i < 16; ++i) {
        vec3 u = fract(vec3((float(i) + 0.5) / 16.0, float(i) * 0.618034, float(i) * 0.754878));
        vec3 wi = dsbrdf_sample(wo, u);
        float density = dsbrdf_pdf(wi, wo);
        if (density > 0.0) light += 0.2 / 16.0 * dsbrdf_eval(wi, wo) * wi.z / density;
    }
    return light;
}
"""
SHADERTOY = """
void mainImage(out vec4 color, vec2 at) {
    vec2 p = 1.2 * (2.0 * at - iResolution.xy) / min(iResolution.x, iResolution.y);
    float r2 = dot(p, p);
    vec3 normal = vec3(p, sqrt(max(1.0 - r2, 0.0)));
    vec3 light = r2 < 1.0 ? lit(normal, vec3(0.0, 0.0, 1.0)) : vec3(0.02);
    color = vec4(pow(light, vec3(1.0 / 2.2)), 1.0);
}
"""
THREE = """<!doctype html>
<meta charset="utf-8">
<title>dsbrdf in three.js</title>
<body style="margin: 0; background: #222">
<script type="importmap">
{"imports": {"three": "https://cdn.jsdelivr.net/npm/three@0.187.0/build/three.module.js"}}
</script>
<script type="module">
import * as THREE from "three";
const vertex = `
out vec3 v_normal, v_view;
void main() {
    vec4 world = modelMatrix * vec4(position, 1.0);
    v_normal = mat3(modelMatrix) * normal;
    v_view = cameraPosition - world.xyz;
    gl_Position = projectionMatrix * viewMatrix * world;
}`;
const fragment = `
in vec3 v_normal, v_view;
out vec4 color;
%s
void main() {
    color = vec4(pow(lit(normalize(v_normal), normalize(v_view)), vec3(1.0 / 2.2)), 1.0);
}`;
const scene = new THREE.Scene();
const material = new THREE.ShaderMaterial({
    vertexShader: vertex, fragmentShader: fragment, glslVersion: THREE.GLSL3,
});
scene.add(new THREE.Mesh(new THREE.SphereGeometry(1, 96, 48), material));
const camera = new THREE.PerspectiveCamera(26, innerWidth / innerHeight, 0.1, 100);
camera.position.z = 5.4;
const renderer = new THREE.WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
renderer.setSize(innerWidth, innerHeight);
document.body.append(renderer.domElement);
renderer.render(scene, camera);
</script>
"""


def main(path: str = "", folder: str = ".") -> None:
    """Write both files."""
    model = dsbrdf.load(path) if path else dsbrdf.fit(dsbrdf.material("rough-copper"), n_lobes=3).model
    code = shader.baked(model) + LIGHTING
    (Path(folder) / "shadertoy.glsl").write_text(code + SHADERTOY, encoding="utf-8")
    (Path(folder) / "three.html").write_text(THREE % code, encoding="utf-8")
    print("shadertoy.glsl, three.html")


if __name__ == "__main__":
    main(*sys.argv[1:])
