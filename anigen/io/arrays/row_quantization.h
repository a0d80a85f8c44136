#pragma once
#include <string>

#include "anigen/io/arrays/ndarray.h"

namespace anigen::io {

/// Ends the name of the scales that belong to a quantized array.
inline constexpr const char* kRowScaleSuffix = ".row_scale";

/// Weights in eight bits: of every floating-point array w with two axes or more and at least 1,024 elements, row i
/// along the first axis becomes q = round(w / s_i) in int8 with s_i = max_j |w_ij| / 127, and the scales s [rows],
/// fp32, follow the array under its name and kRowScaleSuffix (symmetric quantization per output channel, Krishnamoorthi
/// 2018, arXiv 1806.08342, section 3.1.3). |w − s q| is at most s / 2. Smaller arrays of fp32 or fp64 become halves,
/// others stay. @param file for messages @throws InputError for values that are not finite, or that half precision
/// lacks
NamedArrays quantize_rows(const NamedArrays& arrays, const std::string& file);

/// The inverse, of one array: s q, fp32. @param steps q, int8 @param name of w, for messages
/// @throws InputError for scales of another count or type than the rows, negative ones and such as are not finite
NdArray dequantized(const NdArray& steps, const NdArray& scales, const std::string& file, const std::string& name);

/// An array of fp32 or fp64 in half precision; others as they are. @throws InputError for a value that is not finite or
/// too large
NdArray halved(const NdArray& array, const std::string& file, const std::string& name);

}  // namespace anigen::io
