#include "anigen/data/backgrounds.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/parallel.h"
#include "anigen/io/image_resize.h"

namespace anigen::data {

namespace {

using Color = std::array<float, 3>;

float smooth_step(double x) {
  const double t = std::clamp(x, 0.0, 1.0);
  return static_cast<float>(t * t * (3.0 - 2.0 * t));
}

float mixed(float a, float b, double t) { return static_cast<float>(a + (b - a) * t); }

// Greys are as frequent as strong colours.
Color random_color(Rng& rng) {
  const double grey = rng.uniform(), saturation = rng.uniform();
  Color color;
  for (float& value : color)
    value = static_cast<float>(std::clamp(grey + saturation * rng.uniform(-0.5, 0.5), 0.0, 1.0));
  return color;
}

// Another colour, near to the first one as often as not.
Color second_color(const Color& first, Rng& rng) {
  const Color other = random_color(rng);
  const double away = rng.chance(0.5) ? 1.0 : rng.uniform(0.05, 0.4);
  Color color;
  for (std::size_t c = 0; c < 3; ++c) color[c] = mixed(first[c], other[c], away);
  return color;
}

// [3, S, S] of colours between two by a function of the place, u and v in [0, 1] from the upper left corner.
template <typename Share>
std::vector<float> between(const Color& a, const Color& b, int size, const Share& share) {
  const auto side = static_cast<std::size_t>(size), pixels = side * side;
  std::vector<float> planes(3 * pixels);
  for (std::size_t i = 0; i < pixels; ++i) {
    const double u = (static_cast<double>(i % side) + 0.5) / size, v = (static_cast<double>(i / side) + 0.5) / size;
    const double t = share(u, v);
    for (std::size_t c = 0; c < 3; ++c) planes[c * pixels + i] = mixed(a[c], b[c], t);
  }
  return planes;
}

// Random values at the points of a square lattice, interpolated; in [0, 1].
class ValueNoise {
 public:
  ValueNoise(int cells, Rng& rng) : cells_(cells) {
    for (int i = 0; i < (cells + 1) * (cells + 1); ++i) values_.push_back(rng.uniform());
  }
  double at(double u, double v) const {
    const double x = u * cells_, y = v * cells_;
    const int column = std::clamp(static_cast<int>(x), 0, cells_ - 1);
    const int row = std::clamp(static_cast<int>(y), 0, cells_ - 1);
    const double right = smooth_step(x - column), down = smooth_step(y - row);
    const auto value = [&](int r, int c) {
      return values_[static_cast<std::size_t>(r) * static_cast<std::size_t>(cells_ + 1) + static_cast<std::size_t>(c)];
    };
    const double above = value(row, column) + right * (value(row, column + 1) - value(row, column));
    const double below = value(row + 1, column) + right * (value(row + 1, column + 1) - value(row + 1, column));
    return above + down * (below - above);
  }

 private:
  int cells_;
  std::vector<double> values_;
};

// Octaves of twice the frequency and a share of the amplitude each, their mean; in [0, 1].
class FractalNoise {
 public:
  FractalNoise(int size, Rng& rng) {
    const std::size_t octaves = 1 + rng.index(5);
    gain_ = rng.uniform(0.35, 0.8);
    int cells = 2 + static_cast<int>(rng.index(7));
    for (std::size_t i = 0; i < octaves && (i == 0 || cells <= size); ++i, cells *= 2) layers_.emplace_back(cells, rng);
  }
  double at(double u, double v) const {
    double sum = 0.0, weights = 0.0, weight = 1.0;
    for (const ValueNoise& layer : layers_) {
      sum += weight * layer.at(u, v);
      weights += weight;
      weight *= gain_;
    }
    return sum / weights;
  }

 private:
  double gain_ = 0.0;
  std::vector<ValueNoise> layers_;
};

// A wave of the period 1 between 0 and 1, square but for edges of some softness.
double square_wave(double phase, double duty, double softness) {
  const double t = phase - std::floor(phase);
  return smooth_step(t / softness + 0.5) * (1.0 - smooth_step((t - duty) / softness + 0.5)) +
         smooth_step((t - 1.0) / softness + 0.5);
}

struct Direction {
  explicit Direction(Rng& rng) : angle(rng.uniform(0.0, 2.0 * kPi)), x(std::cos(angle)), y(std::sin(angle)) {}
  double along(double u, double v) const { return x * u + y * v; }
  double across(double u, double v) const { return x * v - y * u; }
  double angle, x, y;
};

std::vector<float> gradient(const Color& a, const Color& b, int size, Rng& rng) {
  const Direction direction(rng);
  if (rng.chance(0.3)) {
    const double x = rng.uniform(), y = rng.uniform(), radius = rng.uniform(0.4, 1.2);
    return between(a, b, size, [&](double u, double v) { return smooth_step(std::hypot(u - x, v - y) / radius); });
  }
  return between(a, b, size, [&](double u, double v) {
    return std::clamp(0.5 + direction.along(u - 0.5, v - 0.5) / 1.4, 0.0, 1.0);
  });
}

std::vector<float> stripes(const Color& a, const Color& b, int size, Rng& rng) {
  const Direction direction(rng);
  const double count = rng.uniform(2.0, 16.0), duty = rng.uniform(0.2, 0.8), softness = rng.uniform(0.02, 0.3);
  const double phase = rng.uniform();
  return between(a, b, size, [&](double u, double v) {
    return std::clamp(square_wave(count * direction.along(u, v) + phase, duty, softness), 0.0, 1.0);
  });
}

// 0 or 1 by turns along both axes.
double checked(double x, double y) {
  return static_cast<double>((static_cast<long long>(std::floor(x)) + static_cast<long long>(std::floor(y))) & 1);
}

std::vector<float> checker(const Color& a, const Color& b, int size, Rng& rng) {
  const Direction direction(rng);
  const double count = rng.uniform(2.0, 14.0), x = rng.uniform(), y = rng.uniform();
  return between(a, b, size, [&](double u, double v) {
    return checked(count * direction.along(u, v) + x, count * direction.across(u, v) + y);
  });
}

std::vector<float> blobs(const Color& a, const Color& b, int size, Rng& rng) {
  std::vector<float> planes = between(a, b, size, [](double, double) { return 0.0; });
  const auto side = static_cast<std::size_t>(size), pixels = side * side;
  const std::size_t count = 3 + rng.index(20);
  for (std::size_t i = 0; i < count; ++i) {
    const Color color = rng.chance(0.5) ? second_color(a, rng) : second_color(b, rng);
    const double x = rng.uniform(), y = rng.uniform(), radius = rng.uniform(0.04, 0.3);
    for (std::size_t p = 0; p < pixels; ++p) {
      const double u = (static_cast<double>(p % side) + 0.5) / size, v = (static_cast<double>(p / side) + 0.5) / size;
      const double share = smooth_step(1.5 - std::hypot(u - x, v - y) / radius);
      if (share <= 0.0) continue;
      for (std::size_t c = 0; c < 3; ++c) planes[c * pixels + p] = mixed(planes[c * pixels + p], color[c], share);
    }
  }
  blur_planes(planes, size, rng.uniform(0.0, 0.06) * size);
  return planes;
}

std::vector<float> horizon(const Color& a, const Color& b, int size, Rng& rng) {
  const double height = rng.uniform(0.3, 0.85), slope = rng.uniform(-0.08, 0.08), softness = rng.uniform(0.005, 0.1);
  const double wall = rng.uniform(0.0, 0.3), tiles = rng.uniform(1.0, 6.0), shift = rng.uniform();
  const double contrast = rng.chance(0.5) ? rng.uniform(0.1, 0.5) : 0.0;
  const FractalNoise noise(size, rng);
  const double grain = rng.uniform(0.0, 0.3);
  return between(a, b, size, [&](double u, double v) {
    const double below = v - height - slope * (u - 0.5);
    // Depth of the floor's points falls with the distance from the horizon in the picture.
    const double depth = 0.3 / std::max(below, 0.02);
    const double floor = 1.0 - contrast * checked(tiles * (u - 0.5) * depth + shift, tiles * depth);
    const double share = wall * (1.0 - v) + smooth_step(below / softness + 0.5) * (floor - wall * (1.0 - v));
    return std::clamp(share + grain * (noise.at(u, v) - 0.5), 0.0, 1.0);
  });
}

io::Image reduced_to(const io::Image& picture, int longest) {
  const int longer = std::max(picture.width, picture.height);
  if (longer <= longest) return picture;
  const auto side = [&](int length) {
    return std::max(1, static_cast<int>(std::lround(static_cast<double>(length) * longest / longer)));
  };
  return io::resize_lanczos(picture, side(picture.width), side(picture.height), io::ResizeAlpha::kPremultiplied);
}

// Half of a Gaussian kernel, from its middle outwards; the whole, cut off at four deviations, sums to 1.
std::vector<float> half_kernel(double sigma) {
  const int taps = static_cast<int>(std::lround(8.0 * sigma + 1.0)) | 1;
  std::vector<double> exact(at(taps / 2 + 1));
  double sum = 0.0;
  for (std::size_t k = 0; k < exact.size(); ++k) {
    const double distance = static_cast<double>(k) / sigma;
    exact[k] = std::exp(-0.5 * distance * distance);
    sum += k == 0 ? exact[k] : 2.0 * exact[k];
  }
  std::vector<float> kernel(exact.size());
  for (std::size_t k = 0; k < exact.size(); ++k) kernel[k] = static_cast<float>(exact[k] / sum);
  return kernel;
}

// Places -radius … size - 1 + radius, mirrored into 0 … size - 1 at the outermost ones, which are not repeated.
std::vector<int> mirrored_places(int size, int radius) {
  const int period = std::max(1, 2 * (size - 1));
  std::vector<int> places(at(size + 2 * radius));
  for (std::size_t i = 0; i < places.size(); ++i) {
    const int place = std::abs(static_cast<int>(i) - radius) % period;
    places[i] = std::min(place, period - place);
  }
  return places;
}

// sum[x] += weight · (a[x] + b[x])
void add_pair(float* __restrict sum, const float* a, const float* b, float weight, std::size_t count) {
  for (std::size_t x = 0; x < count; ++x) sum[x] += weight * (a[x] + b[x]);
}

void add_scaled(float* __restrict sum, const float* a, float weight, std::size_t count) {
  for (std::size_t x = 0; x < count; ++x) sum[x] += weight * a[x];
}

// Along the rows of one plane, then along its columns.
void blur_plane(float* plane, int size, const std::vector<float>& kernel) {
  const std::size_t side = at(size), radius = kernel.size() - 1;
  const std::vector<int> places = mirrored_places(size, static_cast<int>(radius));
  std::vector<float> padded(places.size()), rows(side * side, 0.0F);
  for (std::size_t y = 0; y < side; ++y) {
    for (std::size_t i = 0; i < places.size(); ++i) padded[i] = plane[side * y + at(places[i])];
    float* row = rows.data() + side * y;
    const float* middle = padded.data() + radius;
    add_scaled(row, middle, kernel[0], side);
    for (std::size_t k = 1; k <= radius; ++k) add_pair(row, middle - k, middle + k, kernel[k], side);
  }
  std::fill_n(plane, side * side, 0.0F);
  const auto row_at = [&](std::size_t place) { return rows.data() + side * at(places[place]); };
  for (std::size_t y = 0; y < side; ++y) {
    float* row = plane + side * y;
    add_scaled(row, row_at(y + radius), kernel[0], side);
    for (std::size_t k = 1; k <= radius; ++k)
      add_pair(row, row_at(y + radius - k), row_at(y + radius + k), kernel[k], side);
  }
}

}  // namespace

std::vector<float> draw_background(Background kind, int size, Rng& rng) {
  const Color a = random_color(rng), b = second_color(a, rng);
  switch (kind) {
    case Background::kGradient:
      return gradient(a, b, size, rng);
    case Background::kNoise: {
      const FractalNoise noise(size, rng);
      const double contrast = rng.uniform(1.0, 4.0);
      return between(a, b, size,
                     [&](double u, double v) { return std::clamp(0.5 + contrast * (noise.at(u, v) - 0.5), 0.0, 1.0); });
    }
    case Background::kStripes:
      return stripes(a, b, size, rng);
    case Background::kChecker:
      return checker(a, b, size, rng);
    case Background::kBlobs:
      return blobs(a, b, size, rng);
    case Background::kHorizon:
      return horizon(a, b, size, rng);
    case Background::kFlat:
      break;
  }
  return between(a, a, size, [](double, double) { return 0.0; });
}

std::vector<float> draw_background(int size, Rng& rng) {
  return draw_background(kBackgrounds[rng.index(kBackgrounds.size())].first, size, rng);
}

std::vector<float> crop_background(const io::Image& picture, int size, Rng& rng) {
  const int shorter = std::min(picture.width, picture.height);
  const int side = std::max(1, static_cast<int>(std::lround(shorter * rng.uniform(1.0 / 3.0, 1.0))));
  const auto offset = [&](int length) {
    return static_cast<int>(rng.index(static_cast<std::size_t>(length - side) + 1));
  };
  const int x = offset(picture.width), y = offset(picture.height);
  const bool mirrored = rng.chance(0.5);
  const double sigma = rng.chance(0.5) ? rng.uniform(0.0, 0.03) * size : 0.0;
  const io::Image part = io::crop(picture, {x, y, x + side, y + side});
  const io::Image square = io::resize_lanczos(part, size, size, io::ResizeAlpha::kSeparate);
  std::vector<float> planes = io::color_planes(square);
  if (mirrored) {
    for (auto row = planes.begin(); row != planes.end(); row += size) std::reverse(row, row + size);
  }
  blur_planes(planes, size, sigma);
  return planes;
}

void blur_planes(std::vector<float>& planes, int size, double sigma) {
  constexpr double kLeastSigma = 0.1;  // a smaller one changes nothing
  if (sigma < kLeastSigma) return;
  const std::size_t pixels = at(size) * at(size);
  const std::vector<float> kernel = half_kernel(sigma);
  for (std::size_t first = 0; first < planes.size(); first += pixels) blur_plane(planes.data() + first, size, kernel);
}

std::vector<io::Image> read_pictures(const std::filesystem::path& folder, int longest, bool cut_out) {
  const std::vector<std::filesystem::path> files = io::picture_files(folder);
  std::vector<io::Image> pictures(files.size());
  parallel_for(files.size(), [&](std::size_t i) {
    io::Image picture = io::read_image(files[i]);
    if (cut_out) {
      if (!io::has_transparency(picture)) {
        throw InputError(files[i].string(), "",
                         "has no transparent pixel; an object to put before other backgrounds must be cut out");
      }
      picture = io::crop(picture, io::condition_box(picture, files[i].string()));
    }
    pictures[i] = reduced_to(picture, longest);
  });
  return pictures;
}

}  // namespace anigen::data
