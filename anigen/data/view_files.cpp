#include "anigen/data/view_files.h"

#include <algorithm>
#include <cstdint>
#include <system_error>

#include "anigen/core/error.h"
#include "anigen/data/latent_files.h"
#include "anigen/data/rigged_item.h"
#include "anigen/io/image_resize.h"
#include "anigen/render/cameras_json.h"

namespace anigen::data {

namespace {

namespace fs = std::filesystem;

render::Frame random_frame(const fs::path& folder, Rng& rng) {
  // At least one frame, and every picture in this folder: read_transforms sees to both.
  const render::Transforms views = render::read_transforms(folder / "transforms.json");
  return views.frames[rng.index(views.frames.size())];
}

fs::path normal_picture(const fs::path& color) {
  const fs::path path = normal_picture_of(color);
  std::error_code error;
  if (fs::is_regular_file(path, error)) return path;
  throw InputError(path.string(), "",
                   "no such picture of normals; prepare the dataset with --view-geometry, or set the dataset's "
                   "condition to color");
}

std::vector<float> planes(const io::Image& image, bool times_alpha) {
  const std::size_t pixels = static_cast<std::size_t>(image.width) * static_cast<std::size_t>(image.height);
  std::vector<float> values(3 * pixels);
  for (std::size_t i = 0; i < pixels; ++i) {
    const std::uint8_t* pixel = image.rgba.data() + 4 * i;
    const float alpha = times_alpha ? static_cast<float>(pixel[3]) / 255.0f : 1.0f;
    for (std::size_t c = 0; c < 3; ++c) values[c * pixels + i] = static_cast<float>(pixel[c]) / 255.0f * alpha;
  }
  return values;
}

constexpr std::size_t kMostPoints = std::size_t{1} << 24;

std::vector<Eigen::Vector3f> points(const io::NamedArrays& arrays, const char* name, const std::string& file) {
  const std::vector<float> flat = named(arrays, name).as<float>();
  std::vector<Eigen::Vector3f> result(flat.size() / 3);
  for (std::size_t i = 0; i < result.size(); ++i) {
    result[i] = {flat[3 * i], flat[3 * i + 1], flat[3 * i + 2]};
    if (!result[i].allFinite()) throw InputError(file, place_of(name, {-1}, i), "is not finite");
  }
  return result;
}

std::vector<Triangle> triangles(const io::NamedArrays& arrays, std::size_t vertices, const std::string& file) {
  const std::vector<std::int64_t> flat = whole_numbers(arrays, "faces", file);
  std::vector<Triangle> result(flat.size() / 3);
  for (std::size_t i = 0; i < flat.size(); ++i) {
    if (flat[i] < 0 || flat[i] >= static_cast<std::int64_t>(vertices)) {
      throw InputError(file, place_of("faces", {-1}, i / 3),
                       "vertex " + std::to_string(flat[i]) + " of " + std::to_string(vertices));
    }
    result[i / 3][i % 3] = static_cast<std::int32_t>(flat[i]);
  }
  return result;
}

std::vector<float> weights(const io::NamedArrays& arrays, const std::string& file) {
  std::vector<float> skin = finite_numbers(arrays, "skin", file);
  for (std::size_t i = 0; i < skin.size(); ++i) {
    if (skin[i] < 0.0f) {
      throw InputError(file, place_of("skin", named(arrays, "skin").shape, i),
                       "is " + std::to_string(skin[i]) + "; weights must not be negative");
    }
  }
  return skin;
}

}  // namespace

fs::path normal_picture_of(const fs::path& color) {
  return color.parent_path() / (color.stem().string() + "_normal.png");
}

ViewImage read_view(const fs::path& folder, int size, Rng& rng) {
  const render::Frame frame = random_frame(folder, rng);
  const io::Image picture =
      io::resize_lanczos(io::read_image(folder / frame.file_path), size, size, io::ResizeAlpha::kSeparate);
  ViewImage view;
  view.image = planes(picture, false);
  view.alpha.resize(view.image.size() / 3);
  for (std::size_t i = 0; i < view.alpha.size(); ++i)
    view.alpha[i] = static_cast<float>(picture.rgba[4 * i + 3]) / 255.0f;
  using Eigen::RowMajor;
  Eigen::Map<Eigen::Matrix<float, 4, 4, RowMajor>>(view.extrinsics.data()) = render::extrinsics(frame).cast<float>();
  Eigen::Map<Eigen::Matrix<float, 3, 3, RowMajor>>(view.intrinsics.data()) = render::intrinsics(frame).cast<float>();
  return view;
}

fs::path condition_folder(const AssetId& asset) { return asset.root / "renders_cond" / asset.id; }

std::vector<std::string> condition_views(const fs::path& folder) {
  std::vector<std::string> names;
  for (const render::Frame& frame : render::read_transforms(folder / "transforms.json").frames)
    names.push_back(frame.file_path);
  return names;
}

namespace {

io::Image cropped_view(const fs::path& color, ConditionPictures pictures) {
  const fs::path path = pictures == ConditionPictures::kNormals ? normal_picture(color) : color;
  const io::Image picture = io::read_image(path);
  return io::crop(picture, io::condition_box(picture, path.string()));
}

}  // namespace

io::Image read_condition_view(const fs::path& folder, Rng& rng, ConditionPictures pictures) {
  return cropped_view(folder / random_frame(folder, rng).file_path, pictures);
}

io::Image condition_picture(const fs::path& color, int size, ConditionPictures pictures) {
  return io::resize_lanczos(cropped_view(color, pictures), size, size, io::ResizeAlpha::kPremultiplied);
}

std::vector<float> planes_on_black(const io::Image& picture) { return planes(picture, true); }

std::vector<float> read_condition_image(const fs::path& folder, int size, Rng& rng, ConditionPictures pictures) {
  return planes_on_black(condition_picture(folder / random_frame(folder, rng).file_path, size, pictures));
}

fs::path first_normal_picture(const fs::path& folder) {
  return normal_picture(folder / render::read_transforms(folder / "transforms.json").frames.front().file_path);
}

std::size_t normalize_skin_rows(std::vector<float>& skin, std::size_t joints) {
  std::size_t unweighted = 0;
  for (std::size_t first = 0; first < skin.size(); first += joints) {
    float* row = skin.data() + first;
    if (*std::max_element(row, row + joints) == 0.0f) {
      row[0] = 1.0f;
      ++unweighted;
    }
    float sum = 0.0f;
    for (std::size_t j = 0; j < joints; ++j) sum += row[j];
    for (std::size_t j = 0; j < joints; ++j) row[j] /= sum;
  }
  return unweighted;
}

void accumulate_skin_as_flow(std::vector<float>& skin, const std::vector<int>& parents) {
  const std::size_t joints = parents.size();
  const std::vector<int> order = parents_first_order(parents, "");
  const auto root = std::find(parents.begin(), parents.end(), -1) - parents.begin();
  std::vector<bool> below(joints, false);
  for (const int joint : order) {
    const auto j = static_cast<std::size_t>(joint);
    below[j] = joint == root || (parents[j] >= 0 && below[static_cast<std::size_t>(parents[j])]);
  }
  for (std::size_t first = 0; first < skin.size(); first += joints) {
    float* row = skin.data() + first;
    // Children before parents: a joint's column is complete before it is added to its parent's.
    for (auto joint = order.rbegin(); joint != order.rend(); ++joint) {
      const auto j = static_cast<std::size_t>(*joint);
      if (parents[j] >= 0 && below[j]) row[parents[j]] += row[j];
    }
    for (std::size_t j = 0; j < joints; ++j) row[j] = std::clamp(row[j], 0.0f, 1.0f);
  }
}

std::filesystem::path rig_path(const AssetId& asset) {
  return asset.root / "skeleton" / asset.id / "skeleton_voxelized.npz";
}

RigArrays read_rig_arrays(const AssetId& asset, std::size_t max_joints) {
  const std::filesystem::path path = rig_path(asset);
  const std::string file = path.string();
  const io::NamedArrays arrays = read_arrays(path, {{"joints", {-1, 3}, kMostPoints},
                                                    {"parents", {-1}, kMostPoints},
                                                    {"skin", {-1, -1}},
                                                    {"vertices", {-1, 3}, 3 * kMostPoints},
                                                    {"faces", {-1, 3}, 6 * kMostPoints}});
  RigArrays rig;
  rig.joints = points(arrays, "joints", file);
  const std::size_t joints = rig.joints.size();
  if (joints == 0 || joints > max_joints) {
    throw InputError(file, "joints",
                     std::to_string(joints) + " joints; between 1 and " + std::to_string(max_joints) + " are possible");
  }
  const std::vector<std::int64_t> parents = whole_numbers(arrays, "parents", file);
  if (parents.size() != joints) {
    throw InputError(file, "parents",
                     "has shape [" + std::to_string(parents.size()) + "] for " + std::to_string(joints) + " joints");
  }
  for (const std::int64_t parent : parents) {
    // Anything outside the joints stays outside when it is narrowed; the check of the tree below reports it.
    rig.parents.push_back(parent < -1 || parent > 1'000'000 ? 1'000'000 : static_cast<int>(parent));
  }
  parents_first_order(rig.parents, file);
  rig.vertices = points(arrays, "vertices", file);
  rig.faces = triangles(arrays, rig.vertices.size(), file);
  rig.face_dtype = named(arrays, "faces").dtype;
  if (rig.faces.empty()) throw InputError(file, "faces", "is empty");
  const std::vector<std::int64_t>& shape = named(arrays, "skin").shape;
  if (shape[0] != static_cast<std::int64_t>(rig.vertices.size()) || shape[1] != static_cast<std::int64_t>(joints)) {
    throw InputError(file, "skin",
                     "has shape [" + std::to_string(shape[0]) + ", " + std::to_string(shape[1]) + "], expected [" +
                         std::to_string(rig.vertices.size()) + ", " + std::to_string(joints) + "]");
  }
  rig.skin = weights(arrays, file);
  return rig;
}

}  // namespace anigen::data
