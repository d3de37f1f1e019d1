"""Which view stands for each cluster: what is asked of its candidates, what is spared, and what was chosen."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass

from pipeline.models.caller import Caller
from pipeline.query.judge import Choice, JudgeConfig, Shown, answer_views, choose_views, is_definite
from pipeline.query.savings import DEFINITE, REDUNDANT, SINGLE_CANDIDATE, Savings
from pipeline.query.stopwatch import Stopwatch
from pipeline.tasks.proposal import Group, Proposal
from schemas.calls import CallRow
from schemas.questions import Question


@dataclass(frozen=True, slots=True, eq=False)
class _Cluster:
    """A cluster and the candidates that are judged."""

    group: Group
    kept: tuple[int, ...]
    """Positions among its candidates, the initial view first."""

    @property
    def pictures(self) -> tuple[int, ...]:
        return tuple(self.group.candidates[position].picture for position in self.kept)


class ViewJudging:
    """The judging of one question's views. What is asked again later is not asked twice.

    Args:
        question: The query.
        proposal: Candidate views.
        caller: Sends the calls.
        config: Design and savings.
        calls: Where the rows are appended.
        watch: Where seconds are kept.
        savings: Counts what is not asked.
    """

    def __init__(
        self,
        question: Question,
        proposal: Proposal,
        caller: Caller,
        config: JudgeConfig,
        calls: list[CallRow],
        watch: Stopwatch,
        savings: Savings,
    ) -> None:
        self._question, self._proposal, self._caller, self._config = question, proposal, caller, config
        self._calls, self._watch, self._savings = calls, watch, savings
        self.answers: list[str | None] = [None] * len(proposal.pictures)
        """Answer from each picture alone; None where it was not asked or came out blank."""
        self.asked: set[int] = set()
        """Pictures asked about."""

    async def choose(self) -> list[Choice]:
        """Return one choice per cluster with views, by `Proposal.seen`; the initial views where nothing is chosen."""
        groups = self._proposal.seen
        if self._config.design == "all_views":
            return [Choice(0) for _ in groups]
        clusters = [_Cluster(group, self._kept(group)) for group in groups]
        judged = [cluster for cluster in clusters if len(cluster.kept) > 1 or not self._config.exact_savings]
        settled: Collection[int] = ()
        if self._config.design != "image":
            settled = await self._answer(clusters, judged)
        self._savings.add("choice", DEFINITE, len(settled))
        for cluster in clusters:
            if cluster not in judged:
                single = len(cluster.group.candidates) == 1
                self._savings.add("choice", SINGLE_CANDIDATE if single else REDUNDANT)
        open_clusters = [cluster for cluster in judged if cluster.group.cluster not in settled]
        with self._watch.stage("choice", len(groups)):
            made = await choose_views(
                self._question,
                {cluster.group.cluster: self._shown(cluster) for cluster in open_clusters},
                self._caller,
                self._calls,
                design=self._config.design,
                savings=self._savings if self._config.exact_savings else None,
            )
        return [made.get(group.cluster, Choice(0)) for group in groups]

    def every_picture(self) -> tuple[int, ...]:
        """Return the pictures of all candidates that no policy drops, cluster by cluster."""
        return tuple(
            group.candidates[position].picture for group in self._proposal.seen for position in self._kept(group)
        )

    async def answer(self, pictures: Iterable[int]) -> None:
        """Ask about pictures not asked about yet."""
        wanted = sorted(set(pictures) - self.asked)
        with self._watch.stage("view_answer", len(wanted)):
            images = [self._proposal.pictures[picture] for picture in wanted]
            subjects = [self._proposal.candidate_of(picture).id for picture in wanted]
            answers = await answer_views(self._question, images, subjects, self._caller, self._calls)
        self.asked.update(wanted)
        for picture, answer in zip(wanted, answers, strict=True):
            self.answers[picture] = answer

    async def _answer(self, clusters: list[_Cluster], judged: list[_Cluster]) -> set[int]:
        """Ask about the views that are judged; return the clusters whose initial answer settles the choice."""
        everything = {candidate.picture for cluster in clusters for candidate in cluster.group.candidates}
        kept = {picture for cluster in clusters for picture in cluster.pictures}
        wanted = {picture for cluster in judged for picture in cluster.pictures}
        settled: set[int] = set()
        if self._config.stop_when_definite:
            await self.answer(cluster.pictures[0] for cluster in judged)
            for cluster in judged:
                text = self.answers[cluster.pictures[0]]
                if len(cluster.kept) > 1 and text is not None and is_definite(text):
                    settled.add(cluster.group.cluster)
        await self.answer(
            picture for cluster in judged if cluster.group.cluster not in settled for picture in cluster.pictures
        )
        self._savings.add("view_answer", REDUNDANT, len(everything - kept))
        self._savings.add("view_answer", SINGLE_CANDIDATE, len(kept - wanted))
        self._savings.add("view_answer", DEFINITE, len(wanted - self.asked))
        return settled

    def _kept(self, group: Group) -> tuple[int, ...]:
        """Positions of the candidates that are judged: the initial view, and the novel ones that no policy drops."""
        if not self._config.skip_redundant_views:
            return tuple(range(len(group.candidates)))
        least = self._config.redundant_share * group.size
        new = (candidate.quality.new_gaussians for candidate in group.candidates)
        return tuple(position for position, count in enumerate(new) if position == 0 or count > least)

    def _shown(self, cluster: _Cluster) -> list[Shown | None]:
        return [
            Shown(self._proposal.pictures[candidate.picture], self.answers[candidate.picture])
            if position in cluster.kept
            else None
            for position, candidate in enumerate(cluster.group.candidates)
        ]
