"""The page of a synchronisation: one file that tells what was found, or what there is where nothing was."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from html_page import Page, assert_controls_are_named, coloured, data_of
from sync_scene import IDS, make_curves, make_document, make_recordings, unsolved

from skytrace.errors import ReconstructionError
from skytrace.estimation.sync_curves import PairCurves, ScoreCurve, SyncCurves
from skytrace.estimation.sync_settings import SyncSettings
from skytrace.report import render_sync_report
from skytrace.report.sync_figures import clock_figures, error_histogram_figure, score_figure, summits_kept
from skytrace.report.sync_graph import graph_figure
from skytrace.report.sync_tables import disagreements, pair_table
from skytrace.report.sync_words import finding_sentences, notes, pair_words, rival_words
from skytrace.report.words import probability

SETTINGS = SyncSettings()
FAILURE = ReconstructionError(
    "synchronise", "no offset fits", counts={"cameras": 5, "pairs": 4}, threshold=0.95, hint="Fly <turns>"
)


def render(document, ids=IDS, curves=None, **more) -> str:
    curves = make_curves(document) if curves is None else curves
    return render_sync_report(document, curves, make_recordings(ids), SETTINGS, name="Evening <flight>", **more)


@pytest.fixture(scope="module")
def html() -> str:
    return render(make_document())


@pytest.fixture(scope="module")
def page(html) -> Page:
    return Page(html)


@pytest.fixture(scope="module")
def data(html):
    return data_of(html)


def test_page_tells_what_was_found(page):
    assert page.text["h1"] == "Evening <flight>"
    main = page.text["main"]
    for text in (
        "3 of 5 cameras are tied to the clock of north; without hill and lake.",
        "2 of 4 pairs with a plausible offset agree with this.",
        "known to within 2.0 to 4.0\N{NO-BREAK SPACE}ms",
        "the least sure camera is east with a confidence of 0.97",
        "hill is not tied in: its track is too short.",
        "east runs at 21.43 frames a second, not at the 30.00 given.",
        "north – south is ambiguous: offsets of 47.500\N{NO-BREAK SPACE}s and 107.50\N{NO-BREAK SPACE}s fit as well",
        "The offset given for south is contradicted by the tracks",
        "1 warning",
        "−31.2500 ± 0.0040",
        "21.4286 Hz, given 30.0000",
        "contradicted",
        "8.25 ± 0.50",
        "34.5",  # ms off the joint clocks
    ):
        assert text in main, text
    assert "could not be synchronised" not in main


def test_page_is_complete_and_well_formed(html, page):
    page.assert_references_resolve()
    page.assert_asks_for_nothing()
    assert_controls_are_named(html)
    assert page.values("data-pair") == ["0", "1", "2", "3"]
    controls = [attrs["id"] for tag, attrs in page.elements if tag in ("select", "button") and "id" in attrs]
    assert controls == ["pair", "previous", "next", "zoom-all", "zoom-chosen"]


def test_page_is_the_same_for_the_same_input(html):
    assert render(make_document()) == html


def test_script_data_holds_every_pair_the_most_telling_first_shown(data):
    assert len(data["pairs"]) == 6  # of the four cameras that saw anything
    assert [pair["edge"] for pair in data["pairs"]] == [0, 1, 3, 2, None, None]
    assert data["start"] == 0
    unknown = data["pairs"][4]
    assert unknown["score"] is unknown["errors"] is unknown["zoom"] is None
    assert "No offset leaves enough time" in unknown["words"][0]


def test_a_failure_is_shown_above_what_there_is():
    document = unsolved(make_document())
    html = render(document, failure=FAILURE)
    page = Page(html)
    main = page.text["main"]
    for text in (
        "The cameras could not be synchronised",
        "No offset fits.",
        "cameras: 5; pairs: 4.",
        "Fly <turns>.",
        "None of the 5 cameras is tied to another.",
        "The most convincing is north – south with a confidence of 0.9980, where 0.95 would tie",
        "Not tied in: each on a clock of its own",
        "0 of 5",
    ):
        assert text in main, text
    assert data_of(html)["start"] == 0
    page.assert_references_resolve()


@pytest.mark.parametrize("n", [0, 1])
def test_a_page_without_any_pair_is_a_page(n):
    document = {**unsolved(make_document()), "pairs": [], "hints": []}
    sights = dict(list(make_curves(make_document()).sights.items())[:n])
    html = render(document, curves=SyncCurves(sights, ()), failure=FAILURE)
    page = Page(html)
    assert "No pair of them has a plausible offset." in page.text["main"]
    assert "One pair of cameras" not in page.text["main"]
    assert data_of(html)["pairs"] == []
    assert len(data_of(html)["clocks"]) == n


def test_names_from_outside_are_escaped():
    nasty = ('<img src=x onerror=alert(1)>"&</script><!--', "<i>b</i>", "c", "d", "e")
    html = render(make_document(nasty), nasty)
    page = Page(html)
    assert nasty[0] in page.text["th"]
    assert nasty[0] in page.text["option"]
    assert not {"img", "i"} & {tag for tag, _ in page.elements}
    assert "<img" not in str(data_of(html)["graph"])


def test_seven_cameras_fit_into_six_megabytes():
    ids = tuple(f"camera-{k}" for k in range(7))
    document = make_document(ids[:5])
    clock = document["cameras"][ids[0]]
    pair = document["pairs"][0]
    document["cameras"] = dict.fromkeys(ids, clock) | {"unseen": {"tied": False, "reason": "it saw nothing"}}
    document["groups"] = [{"reference": ids[0], "cameras": list(ids)}]
    document["pairs"] = [{**pair, "camera0": a, "camera1": b} for k, a in enumerate(ids) for b in ids[k + 1 :]]
    curves = make_curves(document, n_shifts=12_000, n_errors=2000)
    assert len(curves.pairs) == 21
    html = render(document, (*ids, "unseen"), curves)
    assert 4e6 < len(html.encode()) < 6e6


# ---- figures ----


def test_a_thinned_curve_keeps_its_summits_and_what_is_near_the_marks(rng):
    offset_s = np.arange(-500.0, 500.0, 0.1)
    score = rng.random(len(offset_s))
    score[[1234, 8000]] = 5.0, 7.0
    curve = ScoreCurve(offset_s, score, np.full(len(offset_s), 60.0), 2.0)
    kept = summits_kept(curve, [100.0], 300)
    assert {0, 1234, 8000, len(score) - 1} <= set(kept.tolist())
    near = np.flatnonzero(np.abs(offset_s - 100.0) < 9.9)
    assert set(near.tolist()) <= set(kept.tolist())
    assert 300 <= len(kept) <= 300 + 2 + 202
    assert (np.diff(kept) > 0).all()
    np.testing.assert_array_equal(summits_kept(curve, [], 10**6), np.arange(len(score)))


def test_a_curve_is_broken_where_offsets_were_not_searched():
    offset_s = np.r_[np.arange(0.0, 10.0, 0.1), np.arange(50.0, 60.0, 0.1)]
    curve = ScoreCurve(offset_s, 10 + np.sin(offset_s), np.full(200, 60.0), 5.0)
    figure = score_figure(PairCurves("a", "b", curve, chosen_s=30.0), (), 40)
    line, chosen = traces(figure)["score"], traces(figure)["chosen"]
    gap = line["x"].index(None)
    assert line["y"][gap] is line["customdata"][gap] is None
    assert (line["x"][gap - 1], line["x"][gap + 1]) == (pytest.approx(9.7, abs=0.3), pytest.approx(50.3, abs=0.3))
    assert line["x"].count(None) == 1
    assert (chosen["x"], chosen["y"]) == ([30.0], [0.0])


def traces(figure) -> dict[str, dict]:
    return {trace["name"]: trace for trace in figure["data"]}


def test_the_score_figure_marks_the_chosen_offset_and_its_rivals():
    document = make_document()
    pair = make_curves(document).pairs[0]
    found = traces(score_figure(pair, document["pairs"][0]["rivals"], 500))
    assert found["chosen"]["x"] == [-12.5]
    assert found["chosen"]["y"][0] > 900
    assert found["rivals"]["x"] == [47.5, 107.5]
    assert found["best by chance"]["y"] == [180.0, 180.0]
    assert max(found["score"]["y"]) == pytest.approx(found["chosen"]["y"][0], rel=0.1)
    assert "by the other pairs" not in found  # which agree with it


def test_the_score_figure_shows_where_the_other_pairs_put_it():
    document = make_document()
    pair = make_curves(document).pairs[3]
    found = traces(score_figure(pair, (), 500))
    assert found["by the other pairs"]["x"] == [-43.75]
    assert found["chosen"]["x"] == [80.0]
    assert "rivals" not in found


def test_histograms_are_shares_with_their_medians():
    errors = make_curves(make_document()).pairs[0].errors
    assert errors is not None
    before, after = error_histogram_figure(errors)["data"]
    assert before["name"].startswith("before, median 2.")
    assert after["name"].startswith("after, median 0.3")
    for trace in (before, after):
        assert sum(trace["y"][1:-1]) == pytest.approx(1.0, abs=0.01)


def test_timelines_are_on_the_reference_clock():
    document = make_document()
    (title, together), (_, alone) = clock_figures(document, make_curves(document).sights)
    assert title == "On the clock of north"
    bars = [trace["x"] for trace in together["data"] if trace["name"] == "east"]
    assert bars[0][:2] == [-31.25, 94.75]
    assert bars[1][:2] == [-31.25, pytest.approx(33.15)]
    assert {trace["name"] for trace in alone["data"]} == {"hill"}


@pytest.mark.parametrize("upright", [False, True])
def test_the_graph_shows_groups_apart_and_unused_pairs_dotted(upright):
    document = make_document()
    figure = graph_figure(document, 0.95, upright)
    lines = {trace["name"]: trace for trace in figure["data"] if trace.get("showlegend")}
    assert {"confidence from 0.95", "0.5 to 0.95, not used", "below 0.5, not used"} == set(lines)
    assert [lines[name]["line"].get("dash") for name in lines] == [None, "dot", "dot"]
    assert len(lines["confidence from 0.95"]["x"]) == 6  # two lines and a gap after each
    nodes = {re.sub("<.*?>", " ", t["text"][0]).split()[0]: t for t in figure["data"] if t["mode"] == "markers+text"}
    assert set(nodes) == set(IDS)
    assert "reference" in nodes["north"]["text"][0]
    assert "−31.250 s" in nodes["east"]["text"][0]
    axis = "y" if upright else "x"
    tied, untied = ([nodes[c][axis][0] for c in names] for names in (IDS[:3], IDS[3:]))
    assert max(untied) < min(tied) if upright else min(untied) > max(tied)
    assert [note["text"] for note in figure["layout"]["annotations"]] == ["on the clock of north", "not tied in"]
    width, height = figure["size"]
    for node in nodes.values():
        assert 0 < node["x"][0] < width
        assert -height < node["y"][0] < 0
    knobs = next(trace for trace in figure["data"] if trace.get("meta") == "pairs")
    assert len(knobs["x"]) == len(figure["ends"]) == 4


def test_one_group_of_all_needs_no_title():
    document = make_document()
    document["cameras"] = {c: document["cameras"][c] for c in IDS[:3]}
    document["pairs"] = document["pairs"][:3]
    assert graph_figure(document, 0.95, False)["layout"]["annotations"] == []


@pytest.mark.parametrize("solved", [True, False])
def test_plotly_accepts_every_figure(solved):
    import plotly.graph_objects as go

    document = make_document() if solved else unsolved(make_document())
    held = data_of(render(document))
    shown = [*held["graph"].values(), *held["clocks"]]
    for pair in held["pairs"]:
        shown += [pair["score"], *(pair["errors"] or {}).values()]
    for figure in [f for f in shown if f is not None]:
        assert go.Figure({key: coloured(figure[key]) for key in ("data", "layout")}).to_dict()["data"] is not None


# ---- words and tables ----


def test_all_tied_is_said_so():
    document = make_document()
    cameras = {c: {**document["cameras"][c], "confidence": 1.0} for c in IDS[:2]}
    sentences = finding_sentences({**document, "cameras": cameras, "pairs": document["pairs"][:1]}, 0.95)
    assert sentences[0] == "All 2 cameras are tied to the clock of north."
    assert sentences[1] == "1 of 1 pair with a plausible offset agree with this."
    assert "each is tied in with a confidence of >\N{NO-BREAK SPACE}0.9999" in sentences[2]


def test_a_second_group_is_named():
    document = make_document()
    other = {"tied": False, "group": 1, "offset_s": 0.0, "rate": 1.0, "offset_sd_s": 0.0, "rate_sd": 0.0}
    document["cameras"] |= {c: {**other, "confidence": 0.99, "reason": "apart"} for c in ("hill", "lake")}
    document["groups"].append({"reference": "hill", "cameras": ["hill", "lake"]})
    assert "hill and lake are tied to each other, on the clock of hill, but to none of the others." in (
        finding_sentences(document, 0.95)
    )
    assert not [note for note in notes(document, {}) if "not tied in" in note]
    assert len(clock_figures(document, make_curves(document).sights)) == 2


def test_rivals_are_worth_a_word_only_where_something_rests_on_them():
    document = make_document()
    rivals = [{"offset_s": float(k), "score": 1.0} for k in range(7)]
    document["pairs"][3]["rivals"] = rivals  # of a pair that is nothing
    assert not [note for note in notes(document, {}) if "hill is ambiguous" in note]
    document["pairs"][2]["rivals"] = rivals  # of a pair that might be
    (said,) = [note for note in notes(document, {}) if note.startswith("south – east is ambiguous")]
    assert "and 3 more fit nearly as well." in said
    assert rival_words({"score": 1.0, "rivals": rivals[:1]}) == "offsets of 0\N{NO-BREAK SPACE}s fit as well or better."


def test_a_pair_says_why_it_is_used_or_not():
    document = make_document()
    pairs = make_curves(document).pairs

    def words(entry, k):
        return " ".join(pair_words(entry, pairs[k], SETTINGS, (1500.0, 3000.0)))

    used, _, unsure, elsewhere = (document["pairs"][k] for k in (0, 1, 3, 2))
    assert "It is used." in words(used, 0)
    assert "it is the best of all offsets" in words(used, 0)
    assert "1\N{NO-BREAK SPACE}mrad is 1.5\N{NO-BREAK SPACE}px in north and 3.0\N{NO-BREAK SPACE}px in south" in words(
        used, 0
    )
    assert "would not count alone" in words({**used, "confidence": 0.4}, 0)
    assert "a tie takes a confidence of 0.95" in words(unsure, 2)
    assert "the other pairs put it at −43.750" in words(elsewhere, 3)
    assert "too little of its common view" in words({**used, "accepted": False}, 0)
    assert "At no offset" in words(None, 0)
    pairs = [replace(pairs[0], chosen_s=1e3, rank=None), replace(pairs[0], rank=None)]
    assert "not among the offsets searched below" in words(used, 0)
    assert "not among the best offsets" in words(used, 1)


def test_what_pairs_are_off_belongs_to_the_pairs_used_in_the_first_group():
    document = make_document()
    assert disagreements(document) == {("north", "south"): 0.0012, ("north", "east"): 0.0345}
    assert disagreements({**document, "disagreement_s": [0.1]}) == {}
    assert disagreements({}) == {}
    assert pair_table({}) == ""
    partial = pair_table({"pairs": [{"camera0": "a", "camera1": "b", "offset_s": -12.5, "confidence": None}]})
    assert "−12.5" in partial


def test_what_hints_add_to_the_confidence_is_shown():
    pair = make_document()["pairs"][0]
    assert "0.42 without hints" in pair_table({"pairs": [{**pair, "confidence_without_hints": 0.42}]})
    assert "without hints" not in pair_table({"pairs": [{**pair, "confidence_without_hints": 0.998}]})


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "< 0.0001"),
        (0.0071, "0.0071"),
        (0.423, "0.42"),
        (0.9912, "0.9912"),
        (0.99995, "> 0.9999"),
        (1.0, "> 0.9999"),
    ],
)
def test_probabilities_are_told_from_certainty(value, text):
    assert probability(value).replace("\N{NO-BREAK SPACE}", " ") == text
