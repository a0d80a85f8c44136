#include "anigen/generate/preprocess.h"

#include <fcntl.h>
#include <unistd.h>
#include <algorithm>
#include <cmath>
#include <exception>
#include <functional>
#include <limits>
#include <opencv2/dnn.hpp>
#include <opencv2/imgproc.hpp>

#include "anigen/core/files.h"
#include "anigen/core/numeric.h"
#include "anigen/core/process.h"
#include "anigen/io/image_resize.h"
#include "anigen/io/onnx.h"

namespace anigen::generate {

namespace {

void require_bytes(std::size_t found, std::size_t wanted) {
  if (found != wanted) throw InputError("", "mask", "a mask and its picture differ in size");
}

constexpr int kWorkingSide = 512, kRounds = 5, kEdgeColors = 6;
constexpr double kEdgePart = 0.02;      // of the shorter side: surely background
constexpr double kRarePart = 0.02;      // an edge colour below it may be the object, reaching the edge
constexpr double kStandsOut = 0.35;     // of Otsu's threshold: what lies below it is background at first
constexpr double kLeastDistance = 4.0;  // in CIELAB: noise and compression stay below
constexpr double kSmallestPart = 0.05;  // of the largest part

// OpenCV's k-means draws from a generator of the thread: the same numbers every time, and nobody else's are disturbed.
class FixedDraws {
 public:
  FixedDraws() : before_(cv::theRNG().state) { cv::theRNG().state = 1; }
  ~FixedDraws() { cv::theRNG().state = before_; }
  FixedDraws(const FixedDraws&) = delete;
  FixedDraws& operator=(const FixedDraws&) = delete;

 private:
  std::uint64_t before_;
};

cv::Mat working_copy(const io::Image& image) {
  const cv::Mat rgba(image.height, image.width, CV_8UC4, const_cast<std::uint8_t*>(image.rgba.data()));
  cv::Mat bgr;
  cv::cvtColor(rgba, bgr, cv::COLOR_RGBA2BGR);
  const double scale = static_cast<double>(kWorkingSide) / std::max(image.width, image.height);
  if (scale >= 1.0) return bgr;
  const auto side = [scale](int length) { return std::max(1, static_cast<int>(std::lround(scale * length))); };
  cv::Mat small;
  cv::resize(bgr, small, cv::Size(side(image.width), side(image.height)), 0.0, 0.0, cv::INTER_AREA);
  return small;
}

// 255 along the edge of the picture, 0 inside.
cv::Mat edge_of(const cv::Size& size) {
  const int width = std::max(1, static_cast<int>(std::lround(kEdgePart * std::min(size.width, size.height))));
  cv::Mat edge(size, CV_8U, cv::Scalar(255));
  if (size.width > 2 * width && size.height > 2 * width)
    edge(cv::Rect(width, width, size.width - 2 * width, size.height - 2 * width)).setTo(0);
  return edge;
}

// The colours that are common along the edge, [K, 3].
cv::Mat edge_colors(const cv::Mat& lab, const cv::Mat& edge) {
  std::vector<cv::Vec3f> samples;
  for (int y = 0; y < lab.rows; ++y) {
    for (int x = 0; x < lab.cols; ++x) {
      if (edge.at<std::uint8_t>(y, x) != 0) samples.push_back(lab.at<cv::Vec3f>(y, x));
    }
  }
  const cv::Mat table(static_cast<int>(samples.size()), 3, CV_32F, samples.data());
  cv::Mat labels, centers, common;
  cv::kmeans(table, std::min(kEdgeColors, table.rows), labels,
             cv::TermCriteria(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 20, 0.1), 2, cv::KMEANS_PP_CENTERS,
             centers);
  for (int k = 0; k < centers.rows; ++k) {
    if (cv::countNonZero(labels == k) >= kRarePart * table.rows) common.push_back(centers.row(k));
  }
  return common;
}

// Of every pixel to the nearest edge colour, CIELAB.
cv::Mat distance_to_edge(const cv::Mat& bgr, const cv::Mat& edge) {
  cv::Mat lab;
  bgr.convertTo(lab, CV_32F, 1.0 / 255.0);
  cv::cvtColor(lab, lab, cv::COLOR_BGR2Lab);
  cv::GaussianBlur(lab, lab, cv::Size(0, 0), 1.0);
  const cv::Mat colors = edge_colors(lab, edge);
  cv::Mat distance(lab.size(), CV_32F);
  for (int y = 0; y < lab.rows; ++y) {
    for (int x = 0; x < lab.cols; ++x) {
      double nearest = std::numeric_limits<double>::max();
      for (int k = 0; k < colors.rows; ++k) {
        const cv::Vec3f color(colors.at<float>(k, 0), colors.at<float>(k, 1), colors.at<float>(k, 2));
        nearest = std::min(nearest, cv::norm(lab.at<cv::Vec3f>(y, x) - color));
      }
      distance.at<float>(y, x) = static_cast<float>(nearest);
    }
  }
  return distance;
}

// Between the background's distances and the object's.
double standing_out(const cv::Mat& distance) {
  constexpr double kSteps = 2.0;  // of the histogram, per unit
  cv::Mat bytes, unused;
  distance.convertTo(bytes, CV_8U, kSteps);
  const double otsu = cv::threshold(bytes, unused, 0.0, 255.0, cv::THRESH_BINARY | cv::THRESH_OTSU) / kSteps;
  return std::max(kLeastDistance, kStandsOut * otsu);
}

constexpr double kLeastMaximum = 1e-6;  // a black picture is not divided by 0

// A side that the file fixes, or the one asked for.
int input_side(std::int64_t fixed, const MattingOptions& options) {
  const std::int64_t side = fixed > 0 ? fixed : options.size;
  if (side >= 1 && side <= io::kMostPixelsPerSide) return static_cast<int>(side);
  throw InputError(options.network.string(), "", "wants pictures of " + std::to_string(side) + " pixels on a side");
}

void check_normalization(const MattingOptions& options) {
  for (std::size_t c = 0; c < 3; ++c) {
    if (std::isfinite(options.mean[c]) && std::isfinite(options.deviation[c]) && options.deviation[c] > 0.0) continue;
    throw InputError("", "matting network", "means must be finite and deviations positive");
  }
}

std::string first_line(const std::string& text) { return text.substr(0, text.find('\n')); }

[[noreturn]] void refuse(const std::string& name, const std::string& what, const std::string& problem) {
  throw InputError(name, "", "OpenCV " CV_VERSION " cannot " + what + " this network: " + first_line(problem));
}

// Loads a network in a process of its own first, without rights: OpenCV crashes on some damaged ones.
void try_to_load(const std::function<cv::dnn::Net()>& load, const std::filesystem::path& network) {
  constexpr double kSeconds = 30.0, kBytesPerSecond = 16.0 * 1024 * 1024;
  constexpr std::uint64_t kMemory = std::uint64_t{2} << 30, kMemoryPerByte = 8;
  const std::uintmax_t bytes = std::filesystem::file_size(network);
  ProcessLimits limits;
  limits.cpu_seconds = kSeconds + static_cast<double>(bytes) / kBytesPerSecond;
  limits.more_memory = kMemory + kMemoryPerByte * bytes;
  limits.sandbox = SandboxRights{};
  const GuardedWork tried = run_guarded(
      [&load]() -> std::string {
        // Protocol Buffers write their own account of an error, and there is no other thread to run on.
        ::dup2(::open("/dev/null", O_RDONLY), STDERR_FILENO);
        cv::setNumThreads(1);
        try {
          load();
          return "";
        } catch (const cv::Exception& error) {
          return error.err;
        } catch (const std::exception& error) {
          return error.what();
        }
      },
      limits);
  if (!tried.finished) refuse(network.string(), "read", "it " + tried.failure);
  if (!tried.result.empty()) refuse(network.string(), "read", tried.result);
}

// [1, 3, H, W], every channel ((value / largest value) - mean) / deviation
cv::Mat network_input(const io::Image& image, const MattingOptions& options) {
  const std::size_t pixels = image.rgba.size() / io::kImageChannels;
  std::uint8_t largest = 0;
  for (std::size_t i = 0; i < pixels; ++i) {
    for (std::size_t c = 0; c < 3; ++c) largest = std::max(largest, image.rgba[io::kImageChannels * i + c]);
  }
  const double maximum = std::max(static_cast<double>(largest), kLeastMaximum);
  cv::Mat blob({1, 3, image.height, image.width}, CV_32F);
  float* to = blob.ptr<float>();
  for (std::size_t c = 0; c < 3; ++c) {
    for (std::size_t i = 0; i < pixels; ++i) {
      const double value = image.rgba[io::kImageChannels * i + c] / maximum;
      *to++ = static_cast<float>((value - options.mean[c]) / options.deviation[c]);
    }
  }
  return blob;
}

// The mask's plane, stretched to 0 … 255. @param output [1, 1, H, W], [1, H, W] or [H, W]
io::Image stretched(const cv::Mat& output, const std::string& name) {
  const int height = output.dims < 2 ? 0 : output.size[output.dims - 2];
  const int width = output.dims < 2 ? 0 : output.size[output.dims - 1];
  const std::size_t pixels = static_cast<std::size_t>(height) * static_cast<std::size_t>(width);
  if (output.type() != CV_32F || pixels == 0 || output.total() != pixels || !output.isContinuous())
    throw InputError(name, "", "its first output is not one mask [1, 1, H, W]");
  std::vector<float> values(output.ptr<float>(), output.ptr<float>() + pixels);
  if (!std::all_of(values.begin(), values.end(), [](float v) { return std::isfinite(v); }))
    throw InputError(name, "", "its mask holds numbers that are not finite");
  const auto [least, most] = std::minmax_element(values.begin(), values.end());
  if (*least < 0.0F || *most > 1.0F) {
    for (float& value : values) value = 1.0F / (1.0F + std::exp(-value));
  }
  const float low = *least, range = *most - low;  // the sigmoid keeps their order
  if (!(range > 0.0F)) throw InputError(name, "", "sees the same everywhere in this picture: no object");
  io::Image mask(width, height);
  for (std::size_t i = 0; i < pixels; ++i) {
    std::fill_n(mask.rgba.begin() + static_cast<std::ptrdiff_t>(io::kImageChannels * i), 3,
                static_cast<std::uint8_t>((values[i] - low) / range * 255.0F));
  }
  return mask;
}

}  // namespace

Background parse_background(const std::string& word) { return chosen("background", word, kBackgroundWords); }

io::Image without_alpha(const io::Image& image) {
  io::Image opaque = image;
  for (std::size_t i = 3; i < opaque.rgba.size(); i += io::kImageChannels) opaque.rgba[i] = 255;
  return opaque;
}

io::Image cut_out(const io::Image& image, const std::vector<std::uint8_t>& mask) {
  require_bytes(io::kImageChannels * mask.size(), image.rgba.size());
  io::Image result = image;
  for (std::size_t i = 0; i < mask.size(); ++i) {
    std::uint8_t* pixel = result.rgba.data() + io::kImageChannels * i;
    for (int c = 0; c < 3; ++c) pixel[c] = byte_product(pixel[c], mask[i]);
    pixel[3] = mask[i];
  }
  return result;
}

io::Image with_alpha_of(const io::Image& colors, const io::Image& alpha) {
  require_bytes(colors.rgba.size(), alpha.rgba.size());
  io::Image result = colors;
  for (std::size_t i = 3; i < result.rgba.size(); i += io::kImageChannels) result.rgba[i] = alpha.rgba[i];
  return result;
}

io::Image reduced(const io::Image& image, int longest) {
  const int longer = std::max(image.width, image.height);
  if (longer <= longest) return image;
  const double scale = static_cast<double>(longest) / longer;
  const auto side = [scale](int length) { return std::max(1, static_cast<int>(length * scale)); };
  return io::resize_lanczos(image, side(image.width), side(image.height), io::ResizeAlpha::kSeparate);
}

void drop_small_parts(cv::Mat& mask, double share) {
  cv::Mat labels, statistics, centroids;
  const int parts = cv::connectedComponentsWithStats(mask, labels, statistics, centroids, 8);
  int largest = 0;
  for (int i = 1; i < parts; ++i) largest = std::max(largest, statistics.at<int>(i, cv::CC_STAT_AREA));
  std::vector<bool> kept(static_cast<std::size_t>(parts), false);
  for (int i = 1; i < parts; ++i)
    kept[static_cast<std::size_t>(i)] = statistics.at<int>(i, cv::CC_STAT_AREA) >= share * largest;
  for (int y = 0; y < mask.rows; ++y) {
    for (int x = 0; x < mask.cols; ++x) {
      if (!kept[static_cast<std::size_t>(labels.at<int>(y, x))]) mask.at<std::uint8_t>(y, x) = 0;
    }
  }
}

std::vector<std::uint8_t> grabcut_mask(const io::Image& image) {
  std::vector<std::uint8_t> alpha(image.rgba.size() / io::kImageChannels, 0);
  if (alpha.empty()) return alpha;
  const FixedDraws fixed;
  const cv::Mat small = working_copy(image);
  const cv::Mat edge = edge_of(small.size());
  const cv::Mat distance = distance_to_edge(small, edge);
  cv::Mat classes(small.size(), CV_8U, cv::Scalar(cv::GC_PR_FGD));
  classes.setTo(cv::GC_PR_BGD, distance < standing_out(distance));
  classes.setTo(cv::GC_BGD, edge);
  if (cv::countNonZero(classes == cv::GC_PR_FGD) == 0) return alpha;
  cv::Mat background, foreground;  // GrabCut's colour models
  cv::grabCut(small, classes, cv::Rect(), background, foreground, kRounds, cv::GC_INIT_WITH_MASK);
  cv::Mat mask = classes == cv::GC_PR_FGD;
  drop_small_parts(mask, kSmallestPart);
  cv::Mat full(image.height, image.width, CV_8U, alpha.data());
  cv::resize(mask, full, full.size(), 0.0, 0.0, cv::INTER_LINEAR);
  return alpha;
}

struct MattingNetwork::Loaded {
  MattingOptions options;
  std::string name, output;
  int width = 0, height = 0;  // of its input
  cv::dnn::Net net;
};

MattingNetwork::MattingNetwork(const MattingOptions& options) : loaded_(std::make_unique<Loaded>()) {
  check_normalization(options);
  loaded_->options = options;
  loaded_->name = options.network.string();
  const io::OnnxSignature signature = io::read_onnx_signature(options.network);
  if (signature.inputs.size() != 1) {
    throw InputError(loaded_->name, "",
                     "has " + std::to_string(signature.inputs.size()) + " inputs; a matting network takes one picture");
  }
  const std::vector<std::int64_t>& shape = signature.inputs.front().shape;
  if (shape.size() != 4 || (shape[0] > 1) || (shape[1] != 3 && shape[1] != 0))
    throw InputError(loaded_->name, "/" + signature.inputs.front().name, "is not one picture [1, 3, H, W]");
  loaded_->height = input_side(shape[2], options);
  loaded_->width = input_side(shape[3], options);
  loaded_->output = signature.outputs.front().name;
  const std::string model =
      signature.half ? io::onnx_in_full_precision(read_file(options.network), loaded_->name) : std::string();
  const auto load = [&] {
    return model.empty() ? cv::dnn::readNetFromONNX(loaded_->name)
                         : cv::dnn::readNetFromONNX(model.data(), model.size());
  };
  const QuietOpenCv quiet;
  try_to_load(load, options.network);
  try {
    loaded_->net = load();
  } catch (const cv::Exception& error) {
    refuse(loaded_->name, "read", error.err);
  }
}

MattingNetwork::~MattingNetwork() = default;

std::vector<std::uint8_t> MattingNetwork::mask(const io::Image& image) {
  const io::Image seen =
      io::resize_lanczos(without_alpha(image), loaded_->width, loaded_->height, io::ResizeAlpha::kSeparate);
  cv::Mat output;
  const QuietOpenCv quiet;
  try {
    loaded_->net.setInput(network_input(seen, loaded_->options));
    output = loaded_->net.forward(loaded_->output);
  } catch (const cv::Exception& error) {
    refuse(loaded_->name, "run", error.err);
  }
  const io::Image mask =
      io::resize_lanczos(stretched(output, loaded_->name), image.width, image.height, io::ResizeAlpha::kSeparate);
  std::vector<std::uint8_t> alpha(mask.rgba.size() / io::kImageChannels);
  for (std::size_t i = 0; i < alpha.size(); ++i) alpha[i] = mask.rgba[io::kImageChannels * i];
  return alpha;
}

}  // namespace anigen::generate
