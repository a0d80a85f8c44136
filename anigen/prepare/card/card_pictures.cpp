#include "anigen/prepare/card/card_pictures.h"

#include <algorithm>
#include <exception>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/io/gltf.h"
#include "anigen/io/rigs/rig_arrays.h"
#include "anigen/prepare/steps/asset_places.h"
#include "anigen/raytrace/contact_sheet.h"
#include "anigen/raytrace/picture.h"

namespace anigen::prepare {
namespace {

constexpr std::size_t kMostTiles = 24;
constexpr int kTileSize = 192;

std::optional<raytrace::Tile> tile_of(const std::filesystem::path& out, const DatasetRow& row) {
  const AssetPlaces places{out, row.entry.id};
  try {
    Asset asset;
    if (row.records.has("asset")) {
      asset = io::read_gltf(places.asset()).asset;
    } else if (row.records.has("skeleton")) {
      asset = io::to_asset(io::read_rig_npz(places.skeleton(), row.entry.id));
    } else {
      return std::nullopt;
    }
    raytrace::PictureOptions options;
    options.width = options.height = kTileSize;
    options.ambient_occlusion = false;
    options.skeleton = true;
    const std::string caption = row.entry.id.substr(0, 8) + (row.variant > 0 ? " posed" : "") + ", " +
                                std::to_string(row.entry.record.num_joints) + " joints";
    return raytrace::Tile{raytrace::render(asset, options), caption};
  } catch (const std::exception&) {
    return std::nullopt;  // a card is not the place to fail over one picture
  }
}

}  // namespace

std::optional<io::Image> card_pictures(const std::filesystem::path& out, const std::vector<DatasetRow>& rows) {
  const std::size_t count = std::min(kMostTiles, rows.size());
  std::vector<std::optional<raytrace::Tile>> made(count);
  for (std::size_t i = 0; i < count; ++i) made[i] = tile_of(out, rows[i * rows.size() / count]);
  std::vector<raytrace::Tile> tiles;
  for (auto& tile : made) {
    if (tile) tiles.push_back(std::move(*tile));
  }
  if (tiles.empty()) return std::nullopt;
  raytrace::SheetOptions options;
  options.text_height = 9;
  return raytrace::contact_sheet(tiles, options);
}

}  // namespace anigen::prepare
