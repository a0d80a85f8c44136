#pragma once
#include "anigen/models/skin_autoencoder.h"

namespace anigen::models {

/// Rescales freshly initialised weights so that signals keep their size through the network. Ours; the published
/// start is Xavier everywhere, with which the decoder's vertex path — four feed-forward layers without residual or norm
/// — shrinks its input about a hundred times, all logits begin equal, and the first hundreds of steps go into undoing
/// that.
///
/// Feed-forward layers: first weights of variance 1/in, second 1/(0.425 · hidden), 0.425 being E[gelu(z)²] of a
/// standard normal z. The two heads behind the unit-length embeddings take the factor sqrt(E) on top, and queries and
/// keys are scaled by M^(-1/4), so that logits begin at a standard deviation of about 2.
void rescale_to_unit_gain(SkinAutoEncoder& model);

}  // namespace anigen::models
