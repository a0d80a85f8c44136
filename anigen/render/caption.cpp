#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wunused-function"
#include <stb/stb_easy_font.h>
#pragma GCC diagnostic pop

#include <vector>

#include "anigen/core/numeric.h"
#include "anigen/io/opencv_module.h"
#include "anigen/render/caption.h"

namespace anigen::render {

namespace {

constexpr int kLineRows = 12;        ///< of the font's lines, descenders included
constexpr int kCapitalRows = 7;      ///< of its capitals, which begin in row 0
constexpr int kFloatsPerVertex = 4;  ///< x, y, z, a colour
constexpr int kMostStrokes = 24;     ///< of one character; none has more than 20

/// Cells of the font's grid that a line of text fills, [kLineRows · columns].
struct InkedCells {
  int columns = 0;
  std::vector<bool> inked;
};

InkedCells inked_cells(std::string text) {
  InkedCells cells;
  cells.columns = stb_easy_font_width(text.data());
  cells.inked.resize(at(kLineRows) * at(cells.columns), false);
  std::vector<float> vertices(at(4 * kFloatsPerVertex * kMostStrokes) * text.size());
  const int strokes = stb_easy_font_print(0.0f, 0.0f, text.data(), nullptr, vertices.data(),
                                          static_cast<int>(vertices.size() * sizeof(float)));
  for (int i = 0; i < strokes; ++i) {
    const float* first = vertices.data() + 4 * kFloatsPerVertex * i;  // upper left; the third corner is lower right
    const float* third = first + 2 * kFloatsPerVertex;
    const auto right = std::min(cells.columns, static_cast<int>(third[0]));
    const auto bottom = std::min(kLineRows, static_cast<int>(third[1]));
    for (int row = static_cast<int>(first[1]); row < bottom; ++row) {
      for (int column = static_cast<int>(first[0]); column < right; ++column)
        cells.inked[at(row * cells.columns + column)] = true;
    }
  }
  return cells;
}

/// Share of each pixel of a rectangle of a sheet that ink covers.
class Coverage {
 public:
  Coverage(int left, int top, int width, int height)
      : left_(left), top_(top), width_(width), height_(height), shares_(at(width) * at(height), 0.0f) {}

  /// Adds a square, in pixels of the sheet.
  void add(double x, double y, double side) {
    x -= left_;
    y -= top_;
    const int right = std::min(width_ - 1, static_cast<int>(std::floor(x + side)));
    const int bottom = std::min(height_ - 1, static_cast<int>(std::floor(y + side)));
    for (int v = std::max(0, static_cast<int>(std::floor(y))); v <= bottom; ++v) {
      const double high = std::min(y + side, v + 1.0) - std::max(y, static_cast<double>(v));
      for (int u = std::max(0, static_cast<int>(std::floor(x))); u <= right; ++u) {
        const double wide = std::min(x + side, u + 1.0) - std::max(x, static_cast<double>(u));
        shares_[at(v * width_ + u)] += static_cast<float>(high * wide);
      }
    }
  }

  void paint(io::Image& sheet, const std::array<std::uint8_t, 3>& color) const {
    for (int v = std::max(0, -top_); v < std::min(height_, sheet.height - top_); ++v) {
      for (int u = std::max(0, -left_); u < std::min(width_, sheet.width - left_); ++u) {
        const float share = std::min(1.0f, shares_[at(v * width_ + u)]);
        std::uint8_t* pixel = sheet.pixel(left_ + u, top_ + v);
        for (std::size_t c = 0; c < 3; ++c) {
          const float mixed = share * static_cast<float>(color[c]) + (1.0f - share) * static_cast<float>(pixel[c]);
          pixel[c] = static_cast<std::uint8_t>(std::lround(mixed));
        }
      }
    }
  }

 private:
  int left_, top_, width_, height_;
  std::vector<float> shares_;
};

/// By stb_easy_font, whose letters are coarser than OpenCV's. @param text printable ASCII
void put_stb_caption(io::Image& sheet, const std::string& text, int x, int width, int y, int height,
                     const std::array<std::uint8_t, 3>& color) {
  const InkedCells cells = inked_cells(text);
  if (cells.columns == 0 || width <= 0 || height <= 0) return;
  double scale = static_cast<double>(height) / kCapitalRows;
  if (scale * cells.columns > width) scale = static_cast<double>(width) / cells.columns;
  const double rise = kCapitalRows * scale;
  const int top = y - static_cast<int>(std::ceil(rise));
  Coverage coverage(x, top, width, static_cast<int>(std::ceil(kLineRows * scale)) + 1);
  const int left = x + (width - static_cast<int>(std::ceil(scale * cells.columns))) / 2;
  for (int row = 0; row < kLineRows; ++row) {
    for (int column = 0; column < cells.columns; ++column) {
      if (cells.inked[at(row * cells.columns + column)])
        coverage.add(left + scale * column, y - rise + scale * row, scale);
    }
  }
  coverage.paint(sheet, color);
}

}  // namespace

void put_caption(io::Image& sheet, const std::string& line, int x, int width, int y, int height,
                 const Eigen::Vector3f& color) {
  using Put = void (*)(io::Image&, const std::string&, int, int, int, int, const std::array<std::uint8_t, 3>&);
  static const auto by_opencv = reinterpret_cast<Put>(io::opencv_module_entry("anigen_opencv_caption"));
  const Put put = by_opencv != nullptr ? by_opencv : put_stb_caption;
  put(sheet, printable_ascii(line), x, width, y, height, color_bytes(color));
}

}  // namespace anigen::render
