#include "anigen/data/picture_cache.h"

namespace anigen::data {

std::vector<float> PictureCache::read(const std::filesystem::path& folder, int size, Rng& rng, ConditionPictures kind) {
  const auto frames = frames_.get(
      folder.string(), [&] { return condition_views(folder); },
      [](const std::vector<std::string>& names) {
        constexpr std::uintmax_t kOfAString = 32;
        std::uintmax_t bytes = kOfAString;
        for (const std::string& name : names) bytes += kOfAString + name.size();
        return bytes;
      });
  const std::filesystem::path view = folder / (*frames)[rng.index(frames->size())];
  const auto picture = pictures_.get(
      view.string() + (kind == ConditionPictures::kNormals ? "#normal" : "#color") + std::to_string(size),
      [&] { return condition_picture(view, size, kind); },
      [](const io::Image& image) { return sizeof(image) + image.rgba.size(); });
  return planes_on_black(*picture);
}

}  // namespace anigen::data
