#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <opencv2/core.hpp>
#include <opencv2/core/utils/logger.hpp>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/text.h"
#include "anigen/io/image.h"

namespace anigen::generate {

inline constexpr std::size_t kMostViews = 32;  ///< images of one object: each costs a pass in every step

/// Value of a word on the command line. @throws InputError naming the option and listing its words
template <typename Choice>
Choice chosen(const std::string& option, const std::string& word, const Words<Choice>& choices) {
  for (const auto& [choice, known] : choices) {
    if (known == word) return choice;
  }
  throw InputError("", option,
                   "'" + word + "' is none of: " + joined(choices, ", ", &std::pair<Choice, const char*>::second));
}

/// Handling of the background of an image.
enum class Background {
  kAuto,     ///< as published: alpha where there is some, else the network; GrabCut where there is none
  kKeep,     ///< nothing is removed; an alpha channel still counts
  kAlpha,    ///< alpha, and an error for a picture that has none
  kGrabCut,  ///< GrabCut, even where there is alpha
  kNetwork   ///< the network, even where there is alpha
};

inline const Words<Background> kBackgroundWords = {{Background::kAuto, "auto"},
                                                   {Background::kKeep, "keep"},
                                                   {Background::kAlpha, "alpha"},
                                                   {Background::kGrabCut, "grabcut"},
                                                   {Background::kNetwork, "network"}};
/// @throws InputError for another word
Background parse_background(const std::string& word);

/// The colours with alpha dropped, not blended: what lies hidden under transparent pixels is seen again.
io::Image without_alpha(const io::Image& image);

/// The picture with the mask as its alpha, composed over transparent black: colours are multiplied by the mask once, as
/// the published background remover does (docs/reference/flows.md, 5.2).
/// @param image opaque @param mask [H · W]
io::Image cut_out(const io::Image& image, const std::vector<std::uint8_t>& mask);

/// Colours of one picture, alpha of another of the same size.
io::Image with_alpha_of(const io::Image& colors, const io::Image& alpha);

/// The longer side at most `longest` pixels: both sides times longest / longer, rounded down, at least 1 (Lanczos). A
/// picture without alpha is brought to 1024 so before its background is removed (docs/reference/flows.md, 5.2). @param
/// image opaque
io::Image reduced(const io::Image& image, int longest);

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

/// Clears the parts of a mask, pixels above 0 that touch each other, also at corners, that have fewer pixels than this
/// share of the largest one. @param mask CV_8U
void drop_small_parts(cv::Mat& mask, double share);

/// The object of an opaque picture without a trained network: GrabCut (Rother et al. 2004, OpenCV), begun from how far
/// every colour is from those along the picture's edge, on a copy of at most 512 pixels a side. Right for an object
/// that stands clear of a background with few colours; parts that share the background's colour are lost. Parts below a
/// twentieth of the largest one are dropped. Deterministic.
/// @param image alpha is ignored
/// @return [H · W] alpha 0 … 255; all 0 when nothing stands out
std::vector<std::uint8_t> grabcut_mask(const io::Image& image);

/// A network that separates an object from its background, and how it wants its pictures. The defaults are
/// BiRefNet's (docs/reference/flows.md, 5.2), whose weights do not come with this project.
struct MattingOptions {
  std::filesystem::path network;  ///< ONNX, or the folder of a run of ours (generate/trained_matting.h); empty: none
  int size = 1024;                ///< side of its input, where the file leaves it open
  std::array<double, 3> mean{0.485, 0.456, 0.406};
  std::array<double, 3> deviation{0.229, 0.224, 0.225};

  /// True when `network` is a folder: a run of ours, which wants neither size nor mean nor deviation.
  bool is_run() const {
    std::error_code error;
    return std::filesystem::is_directory(network, error);
  }
};

/// Runs such a network through OpenCV, in 32-bit floats whatever it stores: one input [1, 3, H, W]; of its outputs the
/// first one, [1, 1, H', W'], is the mask, as logits, or as probabilities when all of them lie in [0, 1].
class MattingNetwork {
 public:
  /// @throws InputError when the file is not ONNX, has another signature, or holds an operator that OpenCV lacks
  explicit MattingNetwork(const MattingOptions& options);
  ~MattingNetwork();
  MattingNetwork(const MattingNetwork&) = delete;
  MattingNetwork& operator=(const MattingNetwork&) = delete;

  /// The picture is resized to the input's size whatever its aspect (Lanczos), divided by its largest value,
  /// normalised; the mask is stretched to [0, 1], rounded down to bytes and resized back (Lanczos).
  /// @param image alpha is ignored @return [H · W] alpha 0 … 255
  /// @throws InputError when the network cannot run, or sees the same everywhere
  std::vector<std::uint8_t> mask(const io::Image& image);

 private:
  struct Loaded;
  std::unique_ptr<Loaded> loaded_;
};

}  // namespace anigen::generate
