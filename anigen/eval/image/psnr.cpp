#include "anigen/eval/image/psnr.h"

#include <cmath>
#include <cstdint>
#include <limits>

#include "anigen/eval/image/picture_pair.h"

namespace anigen::eval {

double psnr(const io::Image& a, const io::Image& b) {
  check_pair(a, b);
  std::int64_t sum = 0;  // of integers: exact in any order
  for (std::size_t i = 0; i < a.rgba.size(); ++i) {
    if (i % 4 == 3) continue;
    const int difference = int{a.rgba[i]} - int{b.rgba[i]};
    sum += difference * difference;
  }
  if (sum == 0) return std::numeric_limits<double>::infinity();
  const double values = 3.0 * a.width * a.height;
  return 10.0 * std::log10(255.0 * 255.0 * values / static_cast<double>(sum));
}

}  // namespace anigen::eval
