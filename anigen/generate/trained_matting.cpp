#include "anigen/generate/trained_matting.h"

#include <algorithm>
#include <cmath>

#include "anigen/core/error.h"
#include "anigen/generate/mask_parts.h"
#include "anigen/generate/preprocess.h"
#include "anigen/io/image_resize.h"
#include "anigen/nn/state_dict.h"
#include "anigen/vision/condition.h"
#include "anigen/vision/matting.h"

namespace anigen::generate {

namespace {

constexpr double kSmallestShare = 0.02;  // of the largest part
constexpr int kObject = 128;             // alpha from it on is more object than background
constexpr int kFaint = 26;               // alpha below it, a tenth, is none

// Place of a picture in a square: centred, its longer side that of the square.
struct LetterBox {
  int x = 0, y = 0, width = 0, height = 0;
};

LetterBox letter_box(int width, int height, int side) {
  const double scale = static_cast<double>(side) / std::max(width, height);
  const auto length = [&](int of) { return std::clamp(static_cast<int>(std::lround(scale * of)), 1, side); };
  const int wide = length(width), high = length(height);
  return {(side - wide) / 2, (side - high) / 2, wide, high};
}

// The picture in its box, [1, 3, S, S]; margins repeat its edge.
torch::Tensor boxed(const io::Image& image, const LetterBox& box, int side) {
  const io::Image seen = io::resize_lanczos(without_alpha(image), box.width, box.height, io::ResizeAlpha::kSeparate);
  return at::replication_pad2d(vision::color_tensor(seen).unsqueeze(0),
                               {box.x, side - box.x - box.width, box.y, side - box.y - box.height});
}

// [1, 1, H, W] of 0 … 255 → [H · W], rounded to the nearest.
std::vector<std::uint8_t> bytes_of(const torch::Tensor& plane) {
  const torch::Tensor bytes = plane.round().clamp(0.0, 255.0).to(torch::kUInt8).contiguous();
  return {bytes.data_ptr<std::uint8_t>(), bytes.data_ptr<std::uint8_t>() + bytes.numel()};
}

// A mask [height · width] at another size, bilinear.
std::vector<std::uint8_t> resized_mask(const std::vector<std::uint8_t>& mask, const LetterBox& box, int width,
                                       int height) {
  const std::vector<float> values(mask.begin(), mask.end());
  const torch::Tensor plane =
      torch::from_blob(const_cast<float*>(values.data()), {1, 1, box.height, box.width}, torch::kFloat32);
  return bytes_of(at::upsample_bilinear2d(plane, {height, width}, /*align_corners=*/false));
}

}  // namespace

struct TrainedMatting::Loaded {
  vision::MattingUNet network = nullptr;
};

TrainedMatting::TrainedMatting(const std::filesystem::path& run) : loaded_(std::make_unique<Loaded>()) {
  loaded_->network =
      nn::load_trained<vision::MattingUNet>(nn::find_run_model(run, vision::kMattingUNetClass), torch::kCPU);
}

TrainedMatting::~TrainedMatting() = default;

std::vector<std::uint8_t> TrainedMatting::mask(const io::Image& image, const std::string& name) {
  const torch::NoGradGuard no_grad;
  const int side = static_cast<int>(loaded_->network->options().image_size);
  const LetterBox box = letter_box(image.width, image.height, side);
  const torch::Tensor alpha = loaded_->network->forward(boxed(image, box, side)).sigmoid();
  std::vector<std::uint8_t> seen = bytes_of(255.0 * alpha.narrow(2, box.y, box.height).narrow(3, box.x, box.width));
  for (std::uint8_t& value : seen) {
    if (value < kFaint) value = 0;
  }
  drop_small_parts(seen, box.width, box.height, kSmallestShare);
  if (*std::max_element(seen.begin(), seen.end()) < kObject) {
    throw InputError(name, "",
                     "the matting network finds no object; give a picture with transparency, try --background grabcut, "
                     "or keep the background");
  }
  return resized_mask(seen, box, image.width, image.height);
}

}  // namespace anigen::generate
