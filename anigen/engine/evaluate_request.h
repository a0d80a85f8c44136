#pragma once
#include "anigen/engine/evaluate.h"
#include "anigen/eval/pair.h"

namespace anigen::engine {

/// Settings of a pair by the options, those of this library and of anigen-eval; not checked by eval::check().
/// @param further what the library has no option for: kind of registration, transport, poses, LPIPS
/// @throws InputError for an unknown word, which names the program's option
eval::PairSettings pair_settings(const EvaluateOptions& options, eval::PairSettings further = {});

}  // namespace anigen::engine
