#include "anigen/eval/inspect/asset_picture.h"

#include "anigen/raytrace/contact_sheet.h"
#include "anigen/raytrace/picture.h"

namespace anigen::eval {

io::Image asset_picture(const Asset& asset, int size) {
  raytrace::PictureOptions options;
  options.width = options.height = size;
  const raytrace::Tile color{raytrace::render(asset, options), "colour"};
  options.mode = raytrace::PictureMode::kWeights;
  const raytrace::Tile weights{raytrace::render(asset, options), "skin weights"};
  options.skeleton = true;
  const raytrace::Tile skeleton{raytrace::render(asset, options), std::to_string(asset.skeleton.size()) + " joints"};
  raytrace::SheetOptions sheet;
  sheet.columns = 3;
  sheet.title = asset.name;
  return raytrace::contact_sheet({color, weights, skeleton}, sheet);
}

}  // namespace anigen::eval
