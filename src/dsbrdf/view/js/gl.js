// WebGL2 in the few calls the sphere needs: programs, float textures, and drawing into them.

const VERSION = "#version 300 es\nprecision highp float;\nprecision highp int;\nprecision highp sampler2D;\n";
const WHOLE_TARGET = `${VERSION}
void main() {
  gl_Position = vec4(vec2(gl_VertexID % 2, gl_VertexID / 2) * 4.0 - 1.0, 0.0, 1.0);
}`;

/** A context that can draw into float textures; throws an Error for people if there is none. */
export function createContext(canvas) {
  const gl = canvas.getContext("webgl2", { alpha: false, antialias: false, depth: false });
  if (!gl) {
    throw new Error("This browser offers no WebGL2, which the sphere needs. The plots work without it.");
  }
  if (!gl.getExtension("EXT_color_buffer_float")) {
    throw new Error(
      "This graphics device cannot draw into float textures (EXT_color_buffer_float), which the sphere needs. " +
        "The plots work without it.",
    );
  }
  return gl;
}

function compile(gl, type, source) {
  const shader = gl.createShader(type);
  gl.shaderSource(shader, source);
  gl.compileShader(shader);
  return shader;
}

/**
 * A program that fills its target. It compiles on its own; `ready()` says whether it is done without waiting,
 * `check()` waits and throws an Error with the compiler's words.
 */
export class Program {
  constructor(gl, source) {
    this.gl = gl;
    this.shaders = [
      compile(gl, gl.VERTEX_SHADER, WHOLE_TARGET),
      compile(gl, gl.FRAGMENT_SHADER, VERSION + source),
    ];
    this.program = gl.createProgram();
    for (const shader of this.shaders) gl.attachShader(this.program, shader);
    gl.linkProgram(this.program);
    this.parallel = gl.getExtension("KHR_parallel_shader_compile");
    this.locations = null;
  }

  ready() {
    const { gl, parallel } = this;
    return !parallel || gl.getProgramParameter(this.program, parallel.COMPLETION_STATUS_KHR);
  }

  check() {
    const { gl } = this;
    if (this.locations || gl.isContextLost()) return;
    if (!gl.getProgramParameter(this.program, gl.LINK_STATUS)) {
      const logs = this.shaders.map((shader) => gl.getShaderInfoLog(shader));
      throw new Error(
        `A shader does not compile here: ${[...logs, gl.getProgramInfoLog(this.program)].join(" ")}`,
      );
    }
    this.locations = new Map();
    const count = gl.getProgramParameter(this.program, gl.ACTIVE_UNIFORMS);
    for (let i = 0; i < count; i++) {
      const { name, type } = gl.getActiveUniform(this.program, i);
      this.locations.set(name, { type, at: gl.getUniformLocation(this.program, name) });
    }
  }

  /** Fill the bound target. `values`: numbers, arrays or textures by the name of the uniform. */
  draw(values) {
    const { gl } = this;
    this.check();
    gl.useProgram(this.program);
    let unit = 0;
    for (const [name, { type, at }] of this.locations ?? []) {
      const value = values[name];
      if (type === gl.SAMPLER_2D) {
        gl.activeTexture(gl.TEXTURE0 + unit);
        gl.bindTexture(gl.TEXTURE_2D, value);
        gl.uniform1i(at, unit++);
      } else if (type === gl.FLOAT) gl.uniform1f(at, value);
      else if (type === gl.FLOAT_VEC2) gl.uniform2fv(at, value);
      else if (type === gl.FLOAT_VEC3) gl.uniform3fv(at, value);
      else if (type === gl.FLOAT_MAT3) gl.uniformMatrix3fv(at, false, value);
      else gl.uniform1i(at, value);
    }
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  delete() {
    for (const shader of this.shaders) this.gl.deleteShader(shader);
    this.gl.deleteProgram(this.program);
  }
}

/**
 * A texture of RGBA floats, first row first; `data` may be null. `smooth` ones are of half precision, which can be
 * interpolated everywhere, and wrap around from left to right.
 */
export function floatTexture(gl, width, height, data, smooth = false) {
  const texture = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, texture);
  gl.texStorage2D(gl.TEXTURE_2D, 1, smooth ? gl.RGBA16F : gl.RGBA32F, width, height);
  const filter = smooth ? gl.LINEAR : gl.NEAREST;
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, filter);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, filter);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, smooth ? gl.REPEAT : gl.CLAMP_TO_EDGE);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
  if (data) gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, width, height, gl.RGBA, gl.FLOAT, data);
  return texture;
}

/** A float texture that can be drawn into and read back. */
export class Target {
  constructor(gl, width, height) {
    Object.assign(this, { gl, width, height });
    this.texture = floatTexture(gl, width, height, null);
    this.framebuffer = gl.createFramebuffer();
    this.bind();
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.texture, 0);
    this.clear();
  }

  bind() {
    this.gl.bindFramebuffer(this.gl.FRAMEBUFFER, this.framebuffer);
    this.gl.viewport(0, 0, this.width, this.height);
  }

  clear() {
    this.bind();
    this.gl.clearColor(0, 0, 0, 0);
    this.gl.clear(this.gl.COLOR_BUFFER_BIT);
  }

  /** RGBA of all pixels, the lowest row first. */
  read() {
    const data = new Float32Array(4 * this.width * this.height);
    this.bind();
    this.gl.readPixels(0, 0, this.width, this.height, this.gl.RGBA, this.gl.FLOAT, data);
    return data;
  }

  delete() {
    this.gl.deleteFramebuffer(this.framebuffer);
    this.gl.deleteTexture(this.texture);
  }
}
