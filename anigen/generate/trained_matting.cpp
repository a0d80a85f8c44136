#include "anigen/generate/trained_matting.h"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "anigen/core/error.h"
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
cv::Rect letter_box(int width, int height, int side) {
  const double scale = static_cast<double>(side) / std::max(width, height);
  const auto length = [&](int of) { return std::clamp(static_cast<int>(std::lround(scale * of)), 1, side); };
  const int wide = length(width), high = length(height);
  return {(side - wide) / 2, (side - high) / 2, wide, high};
}

// The picture in its box, [1, 3, S, S]; margins repeat its edge.
torch::Tensor boxed(const io::Image& image, const cv::Rect& box, int side) {
  io::Image seen = io::resize_lanczos(without_alpha(image), box.width, box.height, io::ResizeAlpha::kSeparate);
  io::Image square(side, side);
  cv::Mat to(side, side, CV_8UC4, square.rgba.data());
  cv::copyMakeBorder(cv::Mat(box.height, box.width, CV_8UC4, seen.rgba.data()), to, box.y, side - box.y - box.height,
                     box.x, side - box.x - box.width, cv::BORDER_REPLICATE);
  return vision::color_tensor(square).unsqueeze(0);
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
  const cv::Rect box = letter_box(image.width, image.height, side);
  const torch::Tensor alpha = loaded_->network->forward(boxed(image, box, side)).sigmoid().contiguous();
  cv::Mat seen;
  cv::Mat(side, side, CV_32F, alpha.data_ptr<float>())(box).convertTo(seen, CV_8U, 255.0);
  cv::Mat parts = seen >= kFaint;
  drop_small_parts(parts, kSmallestShare);
  seen.setTo(0, parts == 0);
  double most = 0.0;
  cv::minMaxLoc(seen, nullptr, &most);
  if (most < kObject) {
    throw InputError(name, "",
                     "the matting network finds no object; give a picture with transparency, try --background grabcut, "
                     "or keep the background");
  }
  std::vector<std::uint8_t> mask(image.rgba.size() / io::kImageChannels);
  cv::Mat full(image.height, image.width, CV_8U, mask.data());
  cv::resize(seen, full, full.size(), 0.0, 0.0, cv::INTER_LINEAR);
  return mask;
}

}  // namespace anigen::generate
