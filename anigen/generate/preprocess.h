#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
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

}  // namespace anigen::generate
