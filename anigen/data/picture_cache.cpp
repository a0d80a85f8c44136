#include "anigen/data/picture_cache.h"

#include "anigen/core/error.h"

namespace anigen::data {

std::shared_ptr<const std::vector<std::string>> PictureCache::views(const std::filesystem::path& folder) {
  return frames_.get(
      folder.string(), [&] { return condition_views(folder); },
      [](const std::vector<std::string>& names) {
        constexpr std::uintmax_t kOfAString = 32;
        std::uintmax_t bytes = kOfAString;
        for (const std::string& name : names) bytes += kOfAString + name.size();
        return bytes;
      });
}

std::vector<float> PictureCache::read(const std::filesystem::path& folder, int size, Rng& rng, ConditionPictures kind) {
  return read(folder, size, rng.index(views(folder)->size()), kind);
}

std::vector<float> PictureCache::read(const std::filesystem::path& folder, int size, std::size_t view,
                                      ConditionPictures kind) {
  const auto frames = views(folder);
  if (view >= frames->size())
    throw InputError((folder / "transforms.json").string(), "frames",
                     "there is no view " + std::to_string(view) + " among " + std::to_string(frames->size()));
  const std::filesystem::path color = folder / (*frames)[view];
  const auto picture = pictures_.get(
      color.string() + (kind == ConditionPictures::kNormals ? "#normal" : "#color") + std::to_string(size),
      [&] { return condition_picture(color, size, kind); },
      [](const io::Image& image) { return sizeof(image) + image.rgba.size(); });
  return planes_on_black(*picture);
}

}  // namespace anigen::data
