// The twin of kernel/loss/ssim.rs: SSIM of a value and its derivatives.

struct Ssim {
    value: f32,
    d_mean: f32,
    d_square: f32,
    d_cross: f32,
}

// Of the moments under the window: means of x, y, x^2 + y^2 and xy. The derivatives are times `scale`.
fn ssim_grad(mx: f32, my: f32, squares: f32, exy: f32, scale: f32) -> Ssim {
    let variances = squares - mx * mx - my * my + SSIM_C2;
    let luminance = 2.0 * mx * my + SSIM_C1;
    let structure = 2.0 * (exy - mx * my) + SSIM_C2;
    let inverse_means = 1.0 / (mx * mx + my * my + SSIM_C1);
    let inverse_variances = 1.0 / variances;
    let inverse = inverse_means * inverse_variances;
    let s = luminance * structure * inverse;
    let d_mean = scale * 2.0 * (my * (structure - luminance) * inverse + s * mx * (inverse_variances - inverse_means));
    return Ssim(s, d_mean, -(scale * s * inverse_variances), scale * 2.0 * luminance * inverse);
}
