"""Run where slangpy is: CODE, PAIRS.npz and OUT.npz; values, densities and derivatives by wi of exported code."""

import sys
from pathlib import Path

import numpy as np
import slangpy

code, given, out = sys.argv[1:]
with np.load(given) as pairs:
    wi, wo = pairs["wi"].astype(np.float32), pairs["wo"].astype(np.float32)
n = len(wi)
slope = "slope[at.x] = float3(0.0, 0.0, 0.0);"
total = ""
if code.endswith(".slang"):
    total = """
        [Differentiable] float total(float3 a, float3 b) {
            float3 v = dsbrdf_eval(a, b);
            return v.x + v.y + v.z;
        }"""
    slope = """
        var a = diffPair(given_wi[at.x]);
        var b = diffPair(given_wo[at.x]);
        bwd_diff(total)(a, b, 1.0);
        slope[at.x] = a.d;"""
source = f"""{Path(code).read_text()}
StructuredBuffer<float3> given_wi, given_wo;
RWStructuredBuffer<float4> values;
RWStructuredBuffer<float3> slope;
{total}
[shader("compute")] [numthreads(1, 1, 1)] void compute(uint3 at : SV_DispatchThreadID) {{
    values[at.x] = float4(dsbrdf_eval(given_wi[at.x], given_wo[at.x]), dsbrdf_pdf(given_wi[at.x], given_wo[at.x]));
    {slope}
}}"""
device = slangpy.create_device(type=slangpy.DeviceType.cpu)
module = device.load_module_from_source("exported", source)
kernel = device.create_compute_kernel(device.link_program([module], [module.entry_point("compute")]))
usage = slangpy.BufferUsage.shader_resource | slangpy.BufferUsage.unordered_access
arrays = {
    "given_wi": wi,
    "given_wo": wo,
    "values": np.zeros((n, 4), np.float32),
    "slope": np.zeros((n, 3), np.float32),
}
buffers = {
    name: device.create_buffer(data=np.ascontiguousarray(array), struct_size=array.shape[1] * 4, usage=usage)
    for name, array in arrays.items()
}
kernel.dispatch(thread_count=[n, 1, 1], vars=buffers)
np.savez(
    out, **{name: buffers[name].to_numpy().view(np.float32).reshape(n, -1) for name in ("values", "slope")}
)
