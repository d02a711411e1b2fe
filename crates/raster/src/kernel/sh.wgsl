// The twin of kernel/sh.rs: real spherical harmonics of degree 0 to 3.

fn sh_basis(degree: u32, v: vec3<f32>) -> array<f32, 16> {
    var out: array<f32, 16>;
    out[0] = SH_C0;
    if degree < 1u {
        return out;
    }
    let x = v.x;
    let y = v.y;
    let z = v.z;
    out[1] = -SH_C1 * y;
    out[2] = SH_C1 * z;
    out[3] = -SH_C1 * x;
    if degree < 2u {
        return out;
    }
    let xx = x * x;
    let yy = y * y;
    let zz = z * z;
    out[4] = SH_C2[0] * x * y;
    out[5] = SH_C2[1] * y * z;
    out[6] = SH_C2[2] * (zz + zz - xx - yy);
    out[7] = SH_C2[3] * x * z;
    out[8] = SH_C2[4] * (xx - yy);
    if degree < 3u {
        return out;
    }
    let four = 4.0 * zz - xx - yy;
    out[9] = SH_C3[0] * y * (3.0 * xx - yy);
    out[10] = SH_C3[1] * x * y * z;
    out[11] = SH_C3[2] * y * four;
    out[12] = SH_C3[3] * z * (zz + zz - 3.0 * (xx + yy));
    out[13] = SH_C3[4] * x * four;
    out[14] = SH_C3[5] * z * (xx - yy);
    out[15] = SH_C3[6] * x * (xx - 3.0 * yy);
    return out;
}

fn sh_basis_grad(degree: u32, v: vec3<f32>, d: array<f32, 16>) -> vec3<f32> {
    if degree < 1u {
        return vec3(0.0);
    }
    let x = v.x;
    let y = v.y;
    let z = v.z;
    var out = SH_C1 * vec3(-d[3], -d[1], d[2]);
    if degree < 2u {
        return out;
    }
    out.x += SH_C2[0] * y * d[4] - 2.0 * SH_C2[2] * x * d[6] + SH_C2[3] * z * d[7] + 2.0 * SH_C2[4] * x * d[8];
    out.y += SH_C2[0] * x * d[4] + SH_C2[1] * z * d[5] - 2.0 * SH_C2[2] * y * d[6] - 2.0 * SH_C2[4] * y * d[8];
    out.z += SH_C2[1] * y * d[5] + 4.0 * SH_C2[2] * z * d[6] + SH_C2[3] * x * d[7];
    if degree < 3u {
        return out;
    }
    let xx = x * x;
    let yy = y * y;
    let zz = z * z;
    let four = 4.0 * zz - xx - yy;
    out.x += SH_C3[0] * 6.0 * x * y * d[9] + SH_C3[1] * y * z * d[10] - 2.0 * SH_C3[2] * x * y * d[11]
        - 6.0 * SH_C3[3] * x * z * d[12] + SH_C3[4] * (four - 2.0 * xx) * d[13] + 2.0 * SH_C3[5] * x * z * d[14]
        + 3.0 * SH_C3[6] * (xx - yy) * d[15];
    out.y += 3.0 * SH_C3[0] * (xx - yy) * d[9] + SH_C3[1] * x * z * d[10] + SH_C3[2] * (four - 2.0 * yy) * d[11]
        - 6.0 * SH_C3[3] * y * z * d[12] - 2.0 * SH_C3[4] * x * y * d[13] - 2.0 * SH_C3[5] * y * z * d[14]
        - 6.0 * SH_C3[6] * x * y * d[15];
    out.z += SH_C3[1] * x * y * d[10] + 8.0 * SH_C3[2] * y * z * d[11] + SH_C3[3] * (6.0 * zz - 3.0 * (xx + yy)) * d[12]
        + 8.0 * SH_C3[4] * x * z * d[13] + SH_C3[5] * (xx - yy) * d[14];
    return out;
}

fn normalize_grad(unit: vec3<f32>, length: f32, d: vec3<f32>) -> vec3<f32> {
    return (d - unit * dot(unit, d)) * (1.0 / length);
}
