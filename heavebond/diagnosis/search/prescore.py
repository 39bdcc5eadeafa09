"""First-order scores of thousands of laws between two nodes and in signals, from a few adjoint runs along the base model.

A law between two nodes adds through variables w(t) there (forces, flows, heat flows). In the linear time-varying model along
the run of a record (see `localise.ltv_model`), with dy the deviation of the channels over their noise,

    dx' = A dx + B w,     dy = C dx + D w.

For any vector v (n,), lambda(v) is the derivative of v'dy with respect to w at each node and sample. One backward recursion
computes it:

    mu_k = C_k'v_k + phi_k'mu_{k+1},     lambda_k = D_k'v_k + (gamma_{k-1}'mu_k + gamma_k'mu_{k+1}) / 2.

Let s (n,) be the derivative of the residuals with respect to the amplitude of a law. Then s'v is the sum of lambda(v) times
w at unit amplitude over the ports of the law and the samples. The equations of the component give this w from the across
variables of the base run. The score (see `search.scoring`) is z = -s_o'r / |s_o| with s_o = Q s and Q symmetric. So s_o'r =
s'(Q r) is exact to first order, and with v_k (n,) of independent standard normal numbers

    |s_o|**2 = E (s_o'v)**2 = mean over k of (s'(Q v_k))**2.

With `SKETCH` vectors the relative standard deviation of |s_o| is 1/sqrt(2 * SKETCH), 6 %. The same numbers are coordinates
of s_o. They preserve the cosine of two directions to about 1/sqrt(SKETCH) (W. B. Johnson, J. Lindenstrauss, 1984).

A parameter that varies by a factor 1 + a*g(t) is such an input as well: B, D are then the derivatives of the equations with
respect to the parameter, times its value, and w = a*g.

A law before an input adds w = y - u to the signal u that a part reads, and one in a channel adds it to the channel. A law in
series with a port adds w to the position or the across variable that the part reads from its node. An equation that
differentiates what it reads has the rate and the acceleration of w as inputs as well. The equations of these laws, and of
laws with states between nodes, are integrated along the base run (see `search.driven_law`).

The derivative s does not include changes that a law makes to the initial state of a record, for example to the equilibrium
from which a machine starts. A law in place of a part has no prescore, and neither has a law in a domain with several across
variables if it has states or is in series.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from heavebond.core.errors import HeavebondError
from heavebond.core.units import Dimension, parse_quantity
from heavebond.diagnosis.candidates.catalogue import Candidate, EffectNumber
from heavebond.diagnosis.search.base_model import Base
from heavebond.diagnosis.search.driven_law import SERIES, SIGNALS, DrivenLaw
from heavebond.diagnosis.search.schedule import AT_LEAST, FIRST, PROMISING, REFITS, family, largest_gains
from heavebond.diagnosis.search.scoring import SAME, Score, may_be_below_neutral, points_within, value_held
from heavebond.equations.buffered import Buffered
from heavebond.equations.places import sources_of
from heavebond.estimation.residuals import Run
from heavebond.language.definition import FACTOR, Component, Domain, Parameter, Value
from heavebond.language.library import Library
from heavebond.language.symbols import Context, evaluate
from heavebond.localise.ltv_model import AT_ONCE, Known, LtvModel, SourcedRecord, known_of, mapped
from heavebond.numerics.dae import Array
from heavebond.numerics.result import Probe
from heavebond.text.expression import Expr, ExpressionProblem, Name, names

SKETCH, RAW = 128, 8  # number of random vectors for |s_o| and for |s|; of |s| only the order of magnitude is needed
EXACT = 200  # maximum number of exact scores of distant candidates; one takes about as long as a run of the records,
VARIATIONS = 48  # and of variations of parameters, whose forms and variables imitate each other
FEW = 2 * FIRST  # number of near candidates that get an exact score in a further step, apart from the promising ones
RELIABLE, EARLIER = 0.5, 0.25  # shares of the required gain below which a prescore, or an earlier direction, is too small
VISIBLE = 4.0  # smallest gain, two standard deviations: a smaller one is not evidence
RIGID = "its nodes move as one"
SAME_MACHINE = "the same law at nodes that move with these is a candidate"
SMALL = "its first score is small compared with others"
NO_PRESCORE = "its law has no prescore, and other laws of its class there have a small one"
UNSEEN = "the free parameters act alike, or it does nothing"
NO_LINEAR_MODEL = "the model has no linear model along its run"


@dataclass(frozen=True)
class Prescore:
    """First-order score z of a candidate at one choice of its shape parameters. `along` are the amplitudes that are moved
    together, `signed` is true if they may have either sign, and `share` is the estimate of |s_o|/|s|. `sketch` (K,) holds
    coordinates of s_o divided by its length. They give the covariance of scores under the residual of a correct model
    (see `evidence.residual_tests`)."""

    candidate: Candidate
    shapes: Mapping[str, float]
    z: float
    signed: bool
    share: float
    sketch: Array
    along: tuple[str, ...]

    @property
    def gain(self) -> float:
        """The first-order reduction of chi-square."""
        return self.z**2 if self.z > 0 or self.signed else 0.0

    @classmethod
    def of_earlier(cls, base: Base, score: Score) -> Prescore:
        """The score that the direction of a score of an earlier base model has on the residual of this one."""
        projected = base.split(score.direction)[0] if len(score.direction) == len(base.r) else np.zeros(len(base.r))
        share = float(np.linalg.norm(projected))
        z = float(-projected @ base.r / share) if share > SAME else 0.0
        return cls(score.candidate, score.shapes, z, score.signed, share, np.zeros(0), score.along)


@dataclass(frozen=True)
class Prescored:
    """Result of the preselection: the candidates that get an exact score, the prescores of all candidates that have one, the
    `postponed` candidates at joined nodes, whose prescores are small, and the labels of the omitted candidates at distant
    nodes with the reason for each."""

    selected: tuple[Candidate, ...] = ()
    scores: tuple[Prescore, ...] = ()
    postponed: tuple[Candidate, ...] = ()
    left_out: Mapping[str, str] = field(default_factory=dict)

    @property
    def gains(self) -> dict[str, float]:
        """The largest prescored gain of each candidate."""
        return largest_gains(self.scores, lambda candidate: candidate.label)


def select(base: Base, near: Sequence[Candidate], distant: Sequence[Candidate], as_one: Mapping[str, str],
           needed: float = 0.0, earlier: Mapping[str, Score] | None = None) -> Prescored:
    """Select the candidates that need an exact score, from those at nodes that a component connects (`near`) and those at
    distant nodes.

    All laws of a class at a place are selected if the prescored gain of one of them is at least the share `PROMISING` of the
    largest gain, and at least `VISIBLE`. Laws without a prescore are selected together with their class at the place. Of
    the near candidates, the first `REFITS` by their gains and all without a prescore in their class are selected as well,
    and the others are postponed, with those that move no channel. The number of selected distant candidates is at most
    `EXACT`, those with the largest gains. `as_one` maps nodes that move together to one of them. Without distant candidates,
    all near ones are selected: the exact scores of a small diagram take less time than the adjoint runs.

    In a further step, only candidates with the gain `needed` are refitted, apart from a few. Selected are then those with
    the share `RELIABLE` of it, and the first `FEW` by their gains. `earlier` are scores of an earlier step by the label of
    the candidate. Their directions give the gains of candidates without a prescore, as the effects that were added since
    then change them little; a candidate is postponed if this gain is below the share `EARLIER` of the required one.
    """
    joined = {_machine(c, as_one) for c in near}
    left_out, apart = dict[str, str](), dict[object, Candidate]()
    for candidate in distant:
        key = _machine(candidate, as_one)
        if len(key[1]) < len(set(candidate.change.nodes)):
            left_out[candidate.label] = RIGID
        elif key in joined or key in apart:
            left_out[candidate.label] = SAME_MACHINE
        else:
            apart[key] = candidate
    distant = list(apart.values())
    if not distant:
        return Prescored(tuple(near), left_out=left_out)
    tried = [c for c in near if c.attaches in ("across", "at", SERIES, *SIGNALS) and not c.members]
    try:
        scores, without = prescores(base, [*tried, *distant])
    except (HeavebondError, np.linalg.LinAlgError):
        return Prescored(tuple(near), left_out={**left_out, **{c.label: NO_LINEAR_MODEL for c in distant}})
    without_effect = {p.candidate.label for p in scores} - {p.candidate.label for p in scores if p.share > 0}
    scores = [p for p in scores if p.share > SAME]
    least = max(VISIBLE, PROMISING * max((p.gain for p in scores), default=0.0), RELIABLE * needed)
    families = largest_gains(scores, family)
    known, unknown = {p.candidate.label for p in scores}, {c.label for c in without}
    before = earlier or {}
    expected = [Prescore.of_earlier(base, before[c.label]) for c in near if c.label in before and c.label not in known]
    expected_of_family = largest_gains(expected, family)

    def ranked(among: Sequence[Candidate]) -> list[Candidate]:
        return sorted(among, key=lambda c: -families.get(family(c), 0.0))

    hopeful = [c for c in ranked(distant) if families.get(family(c), 0.0) >= least][:EXACT]
    first = {c.label for c in ranked([c for c in tried if family(c) in families])[:FEW if needed else REFITS]}
    estimated = {p.candidate.label for p in expected}
    postponed = [c for c in near if c.label in without_effect or (
        c.label not in first and families.get(family(c), 0.0) < least and (
            expected_of_family[family(c)] < EARLIER * least if c.label in estimated else
            family(c) in families and c in tried))]
    selected = {c.label for c in hopeful}
    left_out |= {c.label: NO_PRESCORE if c.label in unknown else SMALL if c.label in known else UNSEEN
                 for c in distant if c.label not in selected}
    later = {c.label for c in postponed}
    return Prescored((*(c for c in near if c.label not in later), *(c for c in distant if c.label in selected)),
                     tuple(scores), tuple(postponed), left_out)


def select_variations(base: Base, variations: Sequence[Candidate], needed: float = 0.0) -> Prescored:
    """Select the variations of parameters that need an exact score: those of parts for which one prescored gain is at least
    the share `PROMISING` of the largest gain, if their own gain is at least the share `AT_LEAST` of it and the share
    `RELIABLE` of the gain `needed` for a refit, and those without a prescore; at most `VARIATIONS` of either kind."""
    if len(variations) < REFITS:  # their exact scores take less time than the adjoint runs
        return Prescored(tuple(variations))
    try:
        scores, without = prescores(base, variations)
    except (HeavebondError, np.linalg.LinAlgError):
        scores, without = [], list(variations)
    prescored, of_part = Prescored(scores=tuple(scores)), largest_gains(scores, family)
    gains = prescored.gains
    largest = max(gains.values(), default=0.0)
    least = max(AT_LEAST * largest, RELIABLE * needed)
    promising = sorted((c for c in variations if gains.get(c.label, 0.0) >= least > 0
                        and of_part[family(c)] >= PROMISING * largest), key=lambda c: -gains[c.label])
    labels = {c.label for c in (*promising[:VARIATIONS], *without[:VARIATIONS])}
    selected = [c for c in variations if c.label in labels]
    return replace(prescored, selected=tuple(selected),
                   left_out={c.label: SMALL for c in variations if c.label not in labels})


def _machine(candidate: Candidate, as_one: Mapping[str, str]) -> tuple[str, frozenset[str]]:
    """Component and nodes of a candidate, with one name for nodes that move together. Candidates with equal results model
    the same machine."""
    return candidate.component, frozenset(as_one.get(node, node) for node in candidate.change.nodes)


@dataclass(frozen=True)
class Adjoint:
    """Adjoint solution of one record: lambda (V, N) of all vectors at each source (`crown.f`), and the time courses (N,)
    of the across variables and positions of the nodes in the base run, in SI units."""

    gradients: Mapping[str, Array]
    courses: Mapping[str, Array]


def prescores(base: Base, candidates: Sequence[Candidate]) -> tuple[list[Prescore], list[Candidate]]:
    """Compute the prescores of candidates that attach to nodes or to a parameter, at the same choices of shape
    parameters as for an exact score. The second result lists the candidates without a prescore. HeavebondError if the base
    model cannot be linearised."""
    # The vectors v (V, n) of the adjoint runs, in this order: the residual and `SKETCH` random vectors, both without the
    # part that the free parameters explain; `RAW` random vectors without this projection; and, if the inputs have noise,
    # `SKETCH` random residuals of a correct model, without the part that the free parameters explain.
    draw, n = np.random.default_rng(0), len(base.r)
    noise = draw.standard_normal((SKETCH, n))
    vectors = [base.split(base.r)[0][None], np.array([base.split(v)[0] for v in noise]), draw.standard_normal((RAW, n))]
    errors = np.hstack([run.input_errors for run in base.problem.runs])
    if len(errors):
        noise_share = np.sqrt(np.clip(1 - np.mean(errors**2, axis=0), 0.0, 1.0))
        noisy = noise_share * noise + draw.standard_normal((SKETCH, len(errors))) @ errors / np.sqrt(len(errors))
        vectors.append(np.array([base.split(v)[0] for v in noisy]))
    ends = np.cumsum([int(run.counts.sum()) for run in base.problem.runs])
    parts = np.split(np.concatenate(vectors), ends[:-1], axis=1)
    with tempfile.TemporaryDirectory() as folder:
        adjoints = [_adjoint(base, run, part, Path(folder), candidates)
                    for run, part in zip(base.problem.runs, parts, strict=True)]
    library, values = base.problem.experiment.model.library, base.problem.runs[0].assembly.parameter_values
    media = {leaf.component.name: leaf.path for leaf in base.problem.runs[0].assembly.flat.expanded.leaves.values()}
    laws: dict[tuple[str, str, bool], StaticLaw | DrivenLaw | None] = {}
    scores, without = [], []
    for candidate in candidates:
        key = candidate.component, candidate.attaches, candidate.vanishes
        if key not in laws:
            component = library.component(candidate.component)
            laws[key] = StaticLaw.of(library, component, media, values) \
                if candidate.vanishes and candidate.attaches != SERIES else None
            if laws[key] is None and not candidate.change.vary:
                laws[key] = DrivenLaw.of(component, candidate.attaches, candidate.vanishes, library.domains,
                                         _medium_values(component, library, media, values))
        law = laws[key]
        law_scores = _of(candidate, law, adjoints) if law is not None else []
        scores += law_scores
        if not law_scores:
            without.append(candidate)
    return scores, without


def _adjoint(base: Base, run: Run, vectors: Array, folder: Path, candidates: Sequence[Candidate]) -> Adjoint:
    """Solve the backward recursion of one record for all vectors (V, n of this record), at the sources of the candidates:
    the nodes of the diagram, or the parameters that vary."""
    values = base.problem.values_of(base.inner, run.record.name)
    experiment = base.problem.experiment
    # not the parameters in formulas of others, which a factor would not change
    elsewhere = {bound.scope + name.text for leaf in run.assembly.flat.expanded.leaves.values()
                 for bound in leaf.parameters.values() if isinstance(bound.value, Value) for name in names(bound.value.expr)}
    varied = list(dict.fromkeys(name for c in candidates for name in c.change.vary
                                if name in run.assembly.parameter_names and name not in elsewhere))
    variables = list(dict.fromkeys(_variable(c) for c in candidates if c.change.vary))
    inputs = list(dict.fromkeys(c.signal for c in candidates if c.attaches == "input"))
    ports = list(dict.fromkeys(_port(c) for c in candidates if c.attaches == SERIES))
    sourced = SourcedRecord(experiment, run.record, folder, sources_of, varied, [*inputs, *ports])
    known = [known_of(free, values[free.name]) for free in experiment.free.values()]
    point = {n: v for n, v in values.items() if n in sourced.assembly.parameter_values}
    sizes = {**sourced.assembly.parameter_values, **point}
    model = sourced.about(point, [*known, *(Known(name, sizes[name], sizes[name], -np.inf, np.inf, False, False)
                                            for name in varied)])
    weighted = np.zeros((len(vectors), *run.counts.shape))
    # the linear model divides each channel by one constant noise
    weighted[:, run.counts] = run.without_carried(vectors, run.counts) * (sourced.noise[:, None] / run.noise)[run.counts]
    sources = (*sourced.nodes, *sourced.jumped, *varied)
    by_source: dict[object, Array] = dict(zip(sources, backward(model, weighted, len(varied)), strict=True))
    rate = _rate_matrix(model.time)
    gradients: dict[str, Array] = {name: by_source[name] for name in (*sourced.nodes, *varied)}
    for path in sourced.jumps:  # the rates of w are linear in w
        of_rate = by_source[path, 1] + by_source[path, 2] @ rate
        gradients[path] = np.asarray(by_source[path, 0] + of_rate @ rate, np.float32)
    channels = {f"channel {name}": k for k, name in enumerate(experiment.outputs)}
    gradients |= {name: weighted[:, k] / sourced.noise[k] for name, k in channels.items()}
    local = dict(zip((s.name for s in sourced.locals), model.local.T, strict=True))
    flat = sourced.assembly.flat
    courses = {f"{node.name}.{member}": local[shared] for node in sourced.nodes.values()
               for member in (*node.domain.across, *node.domain.positions)
               if (index := flat.names.get(f"{node.name}.{member}")) is not None
               and (shared := flat.unknowns[index].name) in local}
    texts_of = {name: name for name in (*variables, *inputs) if name != "time"} | {
        f"channel {name}": output.shown.text for name, output in experiment.outputs.items()}
    for port in ports:  # the through variable, and the across variable of the node
        domain = flat.domains.get(port)
        texts_of |= {name: name for name in (f"{port}.{m}" for m in (*domain.through, *domain.across))
                     if name in flat.names} if domain is not None else {}
    texts = list(dict.fromkeys(texts_of.values()))
    # the run has the middles between the samples as well
    shown = dict(zip(texts, Probe(model.result.assembly, texts, si=True).values(model.result)[:, ::2], strict=True))
    courses |= {name: shown[text] for name, text in texts_of.items()}
    return Adjoint(gradients, courses | {"time": model.time})


def _rate_matrix(time: Array) -> Any:
    """The sparse matrix (N, N) of the central differences of a column (N,) of samples; one-sided at the ends."""
    from scipy.sparse import csr_matrix

    n = len(time)
    after, before = np.minimum(np.arange(n) + 1, n - 1), np.maximum(np.arange(n) - 1, 0)
    share = 1 / (time[after] - time[before])
    rows = np.arange(n)
    return csr_matrix((np.concatenate([share, -share]), (np.tile(rows, 2), np.concatenate([after, before]))), (n, n))


def _variable(candidate: Candidate) -> str:
    """The variable with which a parameter varies."""
    (part,) = candidate.change.components.values()
    return next(text.lstrip("= ") for text in part.values.values() if text.startswith("="))


def _port(candidate: Candidate) -> str:
    """The port with which a law is in series."""
    return next(end[1:] for ends in candidate.change.nodes.values() for end in ends if end[0] == "-")


def _signal(candidate: Candidate) -> str:
    """The signal in which an effect is: the input, or the channel."""
    return candidate.signal or f"channel {candidate.where[0]}"


def backward(model: LtvModel, vectors: Array, varied: int = 0) -> Array:
    """Compute lambda (sources + varied, V, N) for vectors (V, channels, N) in the channels of the linear model, with respect
    to the sources and to the last `varied` parameters."""
    n, at = model.phi.shape[1], model.phi.shape[2] - varied
    phi, gamma = model.phi[:, :, :n], np.concatenate([model.gamma, model.phi[:, :, at:]], axis=2)
    c, d = model.c[:, :, :n], np.concatenate([model.d, model.c[:, :, at:]], axis=2)
    count = len(model.time)
    gradients = np.empty((count, len(vectors), gamma.shape[2]), np.float32)  # single precision is sufficient for the sums
    mu = np.zeros((len(vectors), n))
    for k in range(count - 1, -1, -1):
        step = mu @ gamma[k] / 2 if k < count - 1 else 0.0
        mu = vectors[:, :, k] @ c[k] + (mu @ phi[k] if k < count - 1 else 0.0)
        gradients[k] = vectors[:, :, k] @ d[k] + step + (mu @ gamma[k - 1] / 2 if k else 0.0)
    if varied:  # the parameters determine the state in which the record begins
        gradients[0, :, -varied:] += mu @ model.start[:, -varied:]
    return np.ascontiguousarray(gradients.transpose(2, 1, 0))


@dataclass(frozen=True)
class StaticLaw:
    """The through variables of a component as formulas of the across variables and positions at its ports, or the factor of
    a parameter as a formula of the variable with which the parameter varies.

    `tangents` maps (courses, parameters) to the derivatives (through, groups) of the through variables with respect to the
    amplitudes, and to the variables `seen`. Amplitudes of one unit form a group and move together. The motion of the
    variables `seen` gives the search ranges of shape parameters. `values` are the values of the parameters that are neither
    amplitudes nor shapes; those of a factor depend on the candidate.
    """

    component: Component
    given: tuple[str, ...]
    through: tuple[str, ...]
    seen: tuple[str, ...]
    groups: int
    tangents: Buffered
    parameters: tuple[str, ...]
    values: Mapping[str, float]

    @classmethod
    def of(cls, library: Library, component: Component, media: Mapping[str, str], values: Mapping[str, float]
           ) -> StaticLaw | None:
        """Build the formulas of a component. `media` maps component names to parts of the diagram, `values` are the
        parameter values of the diagram. None if the equations are not explicit formulas or a parameter has no value."""
        effect = component.effect
        factor = effect is not None and "parameter" in effect.attaches
        signals = [s.name for s in component.signals.values() if s.direction == "out"]
        if effect is None or component.composite or component.when or (component.signals and not factor and (
                component.ports or len(component.signals) != 2 or len(signals) != 1)):
            return None
        domains = {port.name: library.domains.get(port.domain) for port in component.ports.values()}
        formulas = {line.tree.left.text: line.tree.right for line in component.equations
                    if isinstance(line.tree.left, Name) and line.each is None}
        if len(formulas) < len(component.equations) or None in domains.values():
            return None
        inputs = {f"{port}.{m}": ca.SX.sym(m) for port, domain in domains.items() if domain is not None
                  for m in (*domain.across, *domain.positions)} | {name: ca.SX.sym(name) for name in (
                      *(name for name in component.signals if name not in signals),
                      *(["time"] if signals else []))}
        parameters = {name: ca.SX.sym(name) for name in component.parameters}
        through = (FACTOR,) if factor else tuple(signals) if signals else tuple(
            f"{port}.{m}" for port, domain in domains.items() if domain is not None for m in domain.through)
        range_variables = tuple(dict.fromkeys(s.seen for s in effect.shapes.values() if s.seen))
        groups: dict[Dimension, list[ca.SX]] = {}
        for name in effect.amplitude:
            groups.setdefault(component.parameters[name].unit.dimension, []).append(parameters[name])
        known = {**inputs, **parameters}
        context = Context(lambda text, name: known[text] if text in known else known.setdefault(
            text, evaluate(formulas[text], context)), _no_derivative)
        try:
            flows = ca.vertcat(*(evaluate(formulas[name], context) for name in through))
            courses = [evaluate(formulas[name], context) if name in formulas else known[name] for name in range_variables]
            constants = {p.name: value for p in component.parameters.values()
                         if p.name not in (*effect.amplitude, *effect.shapes)
                         for value in [_constant(p, domains.values(), media, values)]}
        except (KeyError, ExpressionProblem, RecursionError):
            return None
        along = ca.horzcat(*(ca.sum2(ca.jacobian(flows, ca.vertcat(*group))) for group in groups.values()))
        return cls(component, tuple(inputs), through, range_variables, len(groups), Buffered(ca.Function(
            "law", [ca.vertcat(*inputs.values()), ca.vertcat(*parameters.values())],
            [ca.densify(ca.vertcat(ca.vec(along), *courses))]).map(AT_ONCE)), tuple(parameters), constants)

    def at(self, courses: Array, numbers: Mapping[str, float]) -> tuple[Array, Array]:
        """The derivatives (groups, through, N) and the variables seen (seen, N) for time courses (given, N) and parameter
        values `numbers`."""
        values = {**dict.fromkeys(self.parameters, 0.0), **self.values, **numbers}
        rows = mapped(self.tangents, [courses], np.array([[values[name]] for name in self.parameters]))[:, 0]
        size = self.groups * len(self.through)
        return rows[:size].reshape(self.groups, len(self.through), -1), rows[size:]


def _no_derivative(value: ca.SX) -> ca.SX:
    raise KeyError("der")


def _of_medium(parameter: Parameter, domains: Iterable[Domain | None], media: Mapping[str, str],
               values: Mapping[str, float]) -> float | None:
    """The value of the medium in the circuit for a parameter; None if it is not one of a medium."""
    full = (f"{media.get(domain.medium or '', '')}.{parameter.medium}" for domain in domains if domain is not None)
    return next((values[name] for name in full if name in values), None) if parameter.medium else None


def _medium_values(component: Component, library: Library, media: Mapping[str, str], values: Mapping[str, float]
                   ) -> dict[str, float]:
    """The values of the medium by the names of the medium's parameters that a component reads."""
    domains = [library.domains.get(port.domain) for port in component.ports.values()]
    return {p.medium: value for p in component.parameters.values()
            if (value := _of_medium(p, domains, media, values)) is not None}


def _constant(parameter: Parameter, domains: Iterable[Domain | None], media: Mapping[str, str], values: Mapping[str, float]
              ) -> float:
    """The value of a parameter that is neither amplitude nor shape: the value of the medium in the circuit, or the
    default. KeyError if it has neither."""
    if parameter.count is not None:
        raise KeyError(parameter.name)
    if (value := _of_medium(parameter, domains, media, values)) is not None:
        return value
    if not isinstance(parameter.default, Value):
        raise KeyError(parameter.name)
    return float(evaluate(parameter.default.expr, Context(_no_name, _no_derivative)))


def _no_name(text: str, name: Expr) -> ca.SX:
    raise KeyError(text)


def _of(candidate: Candidate, law: StaticLaw | DrivenLaw, adjoints: Sequence[Adjoint]) -> list[Prescore]:
    """The prescores of one candidate. The list is empty if only some amplitudes have a neutral value, if a number is held at
    a motion that the law does not show, or if a node, signal or parameter is not a source of the linear model."""
    node = {end.lstrip("+").rpartition(".")[2]: name for name, ends in candidate.change.nodes.items() for end in ends}

    def at_node(name: str) -> str:
        port, _, member = name.partition(".")
        return f"{node.get(port, '')}.{member}"

    sign, fixed = 1, dict[str, float]()
    if candidate.change.vary:
        (part,) = candidate.change.components.values()
        places, input_names = list(candidate.change.vary), [_variable(candidate)]
        fixed = {name: parse_quantity(text)[0] for name, text in part.values.items() if not text.startswith("=")}
    elif candidate.attaches in SIGNALS:
        places, input_names = [_signal(candidate)], [_signal(candidate), "time"]
    elif candidate.attaches == SERIES:
        # what flows into the part flows out of the second port of the law
        place, (flow, *across) = _port(candidate), (name.rpartition(".")[2] for name in law.given[:-1])
        places, input_names = [place], [f"-{place}.{flow}", *(f"{place}.{name}" for name in across), "time"]
    else:
        # a flow into the component is a flow out of the node
        places, sign = [at_node(name) for name in law.through], -1
        input_names = [at_node(name) if "." in name else name for name in law.given]
    if len(candidate.vanishing) not in (0, sum(n.amplitude for n in candidate.numbers)) or not all(
            set(places) <= a.gradients.keys() and {name.lstrip("-") for name in input_names} <= a.courses.keys()
            for a in adjoints):
        return []
    courses = [np.array([-a.courses[name[1:]] if name[0] == "-" else a.courses[name] for name in input_names])
               for a in adjoints]
    short = {n.name: n.name.rpartition(".")[2] for n in candidate.numbers}
    middle = {**{short[n.name]: 1.0 for n in candidate.numbers if n.sought is not None}, **fixed}
    # the motions as by `motion_ranges`, from the variables that the law shows in each record
    follows = any(n.follows for n in candidate.numbers)
    seen = dict(zip(law.seen, np.hstack([law.at(course, middle)[1] for course in courses]), strict=True)) if follows else {}
    motions = {n.name: (float(course.min()), float(course.max())) for n in candidate.numbers
               if n.follows for course in [seen[n.follows.rpartition(".")[2]]]}
    if not np.all(np.isfinite([*motions.values()])):
        return []
    held = {n.name: value_held(n, motions[n.name]) for n in candidate.numbers if n.sought is not None and n.sought.held}
    fixed |= {short[name]: value for name, value in held.items()}
    groups: dict[Dimension, list[EffectNumber]] = {}  # amplitudes of one unit move together
    for number in candidate.vanishing:
        groups.setdefault(number.unit.dimension, []).append(number)
    scores = []
    moving = replace(candidate, numbers=tuple(n for n in candidate.numbers if n.name not in held))
    for shapes in points_within(moving, motions):
        if any(n.sought is not None and n.name not in shapes for n in moving.numbers):  # nothing moves there
            continue
        products = np.zeros((law.groups, len(next(iter(adjoints[0].gradients.values())))))
        for adjoint, course in zip(adjoints, courses, strict=True):
            tangents = law.at(course, {**fixed, **{short[name]: value for name, value in shapes.items()}})[0]
            for k, place in enumerate(places):  # in the precision of the gradients
                size = float(np.abs(tangents[:, k]).max()) or 1.0
                with np.errstate(over="ignore", invalid="ignore"):  # a law with an infinite slope
                    products += sign * size * ((tangents[:, k] / size).astype(np.float32) @ adjoint.gradients[place].T)
        for group, amplitudes in zip(products, list(groups.values()) or [[]], strict=True):
            sketch = group[1:1 + SKETCH]
            with np.errstate(over="ignore"):  # a law with an infinite slope
                length = float(np.sqrt(np.mean(sketch**2)))
                size = float(np.sqrt(np.mean(group[1 + SKETCH:1 + SKETCH + RAW]**2)))
            if not (np.isfinite(length) and np.isfinite(size)):
                continue
            signed, along = any(map(may_be_below_neutral, amplitudes)), tuple(n.name for n in amplitudes)
            if not (length > 0 and size > 0):  # it moves no channel
                scores.append(Prescore(candidate, shapes, 0.0, signed, 0.0, np.zeros(SKETCH), along))
                continue
            noisy = group[1 + SKETCH + RAW:] if len(group) > 1 + SKETCH + RAW else sketch
            z = float(-group[0] / length)
            scores.append(Prescore(candidate, shapes, z, signed, length / size, noisy / length, along))
    return scores
