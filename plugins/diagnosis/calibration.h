// Every number of the diagnosis that was set on simulated cases rather than derived: README.md, "What is calibrated".
#pragma once

namespace teres {

struct Calibration {
    /// Effective number of independent samples in a recording: residuals are structured model error, so that the
    /// likelihood counts as that of nu samples, not of thousands (a raw evidence is always certain, and mostly wrong).
    double nu = 45.0;
    /// Bonus of the answer `none` [nats].
    double none_bonus = 3.5;
    /// Evidence for any effect, where all that it explains may be the model's own error, is at most this [nats].
    double within_floor = 3.0;
    /// Probabilities are p^(1/temperature): sealed cases were right less often than untempered ones said.
    double temperature = 1.5;
    /// ... and where the evidence leaves no doubt still so many are wrong (a search that missed, a cause of another
    /// form): what `unknown` and all that was fitted share evenly.
    double lapse = 0.06;
    /// Share of what a fit narrows a place or times down beyond the search grid that an effect pays for.
    double narrowing = 0.5;
    /// Prior cost of every effect beyond the first [nats].
    double further_effect = 3.0;
    /// ... and of every mechanical effect beyond the first besides: two may stand for the error of form of one. Not of
    /// what is there from the beginning beside what happens later: neither has the other's course in time.
    double further_mechanical = 5.0;
    /// `unknown` is a cause that would leave what right causes leave: this share of the model error ...
    double unknown_left = 0.5;
    /// ... and this share of what is above it, ...
    double unknown_share = 0.03;
    /// ... but nothing of what sensors explain, whose forms are exact however large they are: where these alone are the
    /// best, this share of the model error, ...
    double unknown_left_sensor = 0.65;
    /// ... at the price of the best cause that does as well, and at least this [nats] ...
    double unknown_price = 8.0;
    /// ... but for what that pays for its scales, and for amplitudes beyond so many prior standard deviations each;
    double unknown_amplitude = 2.0;
    /// and besides, because the catalogue holds what is likely [nats].
    double unknown_rarity = 1.0;
    double unknown_least() const { return unknown_price + unknown_rarity; }
    /// Whitened cost per used number that remains on controls beyond the stated noise: of any body, and of one whose
    /// other models differ, as a share of that difference (error_floor.h), without and with inertia.
    double model_error = 0.35;
    double discrepancy_share = 0.15;
    double discrepancy_share_dynamic = 0.5;
    /// Of that error, what lies beside the span of the motion in time; and by what share of its variance the stated
    /// noise may be off (motion_span.h).
    double beside_model = 0.1;
    double beside_noise = 0.2;
    /// Share of what mechanical causes explain that remains because their real form is not quite the catalogue's: a
    /// further effect must explain more than that (besides form_columns.h), unless it is global.
    double form_error = 0.05;
    /// ... of supports at a place of their own: where they begin to hold differs from point to point. Where one of them
    /// or a cut comes first, what it leaves of that share is no evidence for `unknown` either.
    double form_error_local_support = 0.2;
    /// ... with inertia: modulus, damping and mass have the forms of the catalogue.
    double form_error_dynamic = 0.02;
    /// Beside looser forms of what is known no more than so many times what these take up is left as error of form.
    double untold_form = 1.0;
    /// Static recordings: what is left above the floor after a further effect counts so many times as error of form of
    /// those before it.
    double rest_is_form = 2.0;
    /// White part of the model error that the discrepancy columns miss: an absolute part [m] and a share of the
    /// marker's own displacement.
    double white_floor_m = 1.5e-4;
    double white_share = 0.005;
    /// The overlap of whitened signatures from which two causes count as inseparable.
    double confusable_overlap = 0.9;
    /// ... and the evidence by which a fitted one may be behind before any price [nats].
    double same_evidence = 2.0;
};

}  // namespace teres
