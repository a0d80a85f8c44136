#include "anigen/models/anymate/embedders.h"

#include "anigen/core/numeric.h"
#include "anigen/models/anymate/checks.h"

namespace anigen::models::anymate {

Tensor fourier_features(const Tensor& x, std::int64_t num_freqs, bool include_pi) {
  require(x.defined() && x.dim() >= 1 && x.is_floating_point(), "coordinates", "must be floating-point [..., D]");
  require(num_freqs >= 0, "num_freqs", "must not be negative");
  // Formed in fp32 as the released code does: at the highest frequency one unit in the last place moves the sine.
  Tensor frequencies = torch::pow(2.0, torch::arange(num_freqs, torch::kFloat32));
  if (include_pi) frequencies = frequencies * kPi;
  const Tensor arguments = (x.unsqueeze(-1) * frequencies.to(x.options())).flatten(-2);  // [..., D·F]
  return torch::cat({x, arguments.sin(), arguments.cos()}, -1);
}

Tensor spherical_harmonics(const Tensor& directions) {
  require(directions.defined() && directions.dim() >= 1 && directions.size(-1) == 3 && directions.is_floating_point(),
          "directions", "must be floating-point [..., 3]");
  const Tensor x = directions.select(-1, 0), y = directions.select(-1, 1), z = directions.select(-1, 2);
  const Tensor xx = x * x, yy = y * y, zz = z * z;
  const Tensor xy = x * y, yz = y * z, xz = x * z;
  const Tensor saddle = xx - yy;                                  // cos 2φ
  const Tensor cubic_x = xx - 3.0 * yy, cubic_y = 3.0 * xx - yy;  // of degree 3 in x and y, without their first factor
  const Tensor band_3 = 5.0 * zz - 1.0, band_4 = 7.0 * zz - 3.0, band_4_2 = 7.0 * zz - 1.0;
  // Degree after degree, order from -l to l; constants are the usual normalisation on the unit sphere.
  return torch::stack({torch::full_like(x, 0.28209479177387814),
                       0.4886025119029199 * y,
                       0.4886025119029199 * z,
                       0.4886025119029199 * x,
                       1.0925484305920792 * xy,
                       1.0925484305920792 * yz,
                       0.9461746957575601 * zz - 0.31539156525251999,
                       1.0925484305920792 * xz,
                       0.5462742152960396 * saddle,
                       0.5900435899266435 * y * cubic_y,
                       2.890611442640554 * xy * z,
                       0.4570457994644658 * y * band_3,
                       0.3731763325901154 * z * (5.0 * zz - 3.0),
                       0.4570457994644658 * x * band_3,
                       1.445305721320277 * z * saddle,
                       0.5900435899266435 * x * cubic_x,
                       2.5033429417967046 * xy * saddle,
                       1.7701307697799304 * yz * cubic_y,
                       0.9461746957575601 * xy * band_4_2,
                       0.6690465435572892 * yz * band_4,
                       0.10578554691520431 * (35.0 * zz * zz - 30.0 * zz + 3.0),
                       0.6690465435572892 * xz * band_4,
                       0.47308734787878004 * saddle * band_4_2,
                       1.7701307697799304 * xz * cubic_x,
                       0.6258357354491761 * (xx * cubic_x - yy * cubic_y)},
                      -1);
}

}  // namespace anigen::models::anymate
