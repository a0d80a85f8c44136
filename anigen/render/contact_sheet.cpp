#include "anigen/render/contact_sheet.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/render/caption.h"

namespace anigen::render {

namespace {

constexpr std::int64_t kLargestSide = 16384;

/// Straight-alpha picture over an opaque sheet.
void put_image(io::Image& sheet, const io::Image& image, int left, int top) {
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      const std::uint8_t* from = image.pixel(x, y);
      std::uint8_t* to = sheet.pixel(left + x, top + y);
      for (int c = 0; c < 3; ++c)
        to[c] = static_cast<std::uint8_t>((from[c] * from[3] + to[c] * (255 - from[3]) + 127) / 255);
    }
  }
}

}  // namespace

io::Image contact_sheet(const std::vector<Tile>& tiles, const SheetOptions& options) {
  if (tiles.empty()) throw InputError("", "tiles", "a contact sheet needs at least one picture");
  require_between(options.columns, 0, 10'000, "columns");
  require_between(options.gap, 0, 1000, "gap");
  require_between(options.text_height, 4, 200, "text_height");
  int cell_width = 1, cell_height = 1;
  bool captions = false;
  for (const Tile& tile : tiles) {
    if (tile.image.rgba.size() !=
        std::size_t{4} * static_cast<std::size_t>(tile.image.width) * static_cast<std::size_t>(tile.image.height)) {
      throw InputError("", "tiles", "a picture's bytes do not fit its size");
    }
    cell_width = std::max(cell_width, tile.image.width);
    cell_height = std::max(cell_height, tile.image.height);
    captions = captions || !tile.caption.empty();
  }
  const int count = static_cast<int>(tiles.size());
  const int wanted = options.columns > 0 ? options.columns : static_cast<int>(std::ceil(std::sqrt(count)));
  const int columns = std::min(wanted, count), rows = (count + columns - 1) / columns;
  const int caption_height = captions ? 2 * options.text_height : 0;
  const int title_height = options.title.empty() ? 0 : 3 * options.text_height;
  const std::int64_t width = std::int64_t{columns} * (cell_width + options.gap) + options.gap;
  const std::int64_t height =
      title_height + std::int64_t{rows} * (cell_height + caption_height + options.gap) + options.gap;
  if (width > kLargestSide || height > kLargestSide) {
    throw InputError("", "tiles",
                     "the sheet would be " + std::to_string(width) + " x " + std::to_string(height) +
                         " pixels, more than 16384 on a side: use fewer or smaller pictures");
  }

  io::Image sheet(static_cast<int>(width), static_cast<int>(height));
  const std::array<std::uint8_t, 3> background = color_bytes(options.background);
  for (std::size_t i = 0; i < sheet.rgba.size(); i += io::kImageChannels)
    std::copy(background.begin(), background.end(), sheet.rgba.begin() + static_cast<std::ptrdiff_t>(i));
  if (title_height > 0) {
    const int baseline = options.gap + 2 * options.text_height;
    put_caption(sheet, options.title, options.gap, sheet.width - 2 * options.gap, baseline, 3 * options.text_height / 2,
                options.text);
  }
  for (int i = 0; i < count; ++i) {
    const Tile& tile = tiles[at(i)];
    const int left = options.gap + i % columns * (cell_width + options.gap);
    const int top = title_height + options.gap + i / columns * (cell_height + caption_height + options.gap);
    put_image(sheet, tile.image, left + (cell_width - tile.image.width) / 2,
              top + (cell_height - tile.image.height) / 2);
    if (!tile.caption.empty()) {
      put_caption(sheet, tile.caption, left, cell_width, top + cell_height + 3 * options.text_height / 2,
                  options.text_height, options.text);
    }
  }
  return sheet;
}

}  // namespace anigen::render
