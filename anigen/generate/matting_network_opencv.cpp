#include <fcntl.h>
#include <unistd.h>
#include <algorithm>
#include <cmath>
#include <exception>
#include <functional>
#include <opencv2/core.hpp>
#include <opencv2/core/utils/logger.hpp>
#include <opencv2/dnn.hpp>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/process.h"
#include "anigen/generate/matting_network.h"
#include "anigen/io/image_resize.h"
#include "anigen/io/onnx.h"

namespace anigen::generate {

namespace {

/// Keeps OpenCV from writing its own account of an error to the terminal while it is caught and said in our words.
/// The setting is the process's: for code that one thread runs at a time.
class QuietOpenCv {
 public:
  QuietOpenCv() : level_(cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT)) {
    cv::redirectError([](int, const char*, const char*, const char*, int, void*) { return 0; });
  }
  ~QuietOpenCv() {
    cv::redirectError(nullptr);
    cv::utils::logging::setLogLevel(level_);
  }
  QuietOpenCv(const QuietOpenCv&) = delete;
  QuietOpenCv& operator=(const QuietOpenCv&) = delete;

 private:
  cv::utils::logging::LogLevel level_;
};

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
