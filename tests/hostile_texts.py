"""Texts that are to break out of where they are put, and names from a fuzzer."""

from __future__ import annotations

from hypothesis import strategies as st

#: ways out of terminals, formats, shells, spreadsheets and folders
TEXTS = (
    "\x1b[2J\x1b]0;owned\x07", "\x9b31mred", "a\nVolume 1\r\nb",
    "a\r*INCLUDE, INPUT=evil.inp, X=",
    "*INCLUDE, INPUT=evil.inp, X=", "**", "*STEP", "a\u202eb\u2066c", "\u200b", "a\0b",
    "../../evil",
    "C:\\evil", 'end"\n$EndPhysicalNames', "'') ;\nENDSEC;",
    "</title><script>alert(1)</script>", "]]>",
    "&amp;&#10;<!--", "%41%", "%s%n{0}", "$(touch x)`touch y`", "a end_header b", "end_header",
    "endsolid vertex 1 2 3 facet normal", "solid", "COLOR=abcd", "TextureFile x.png", "=1+1", "+1",
    "-2+3", "@SUM(A1)", "\t=1", "Größe ∫ 日本 👩‍🔬", "\udc80\ud83d", "\uffff\U0010ffff",
    "\\X2\\0041\\X0\\",
    "\\", '"', "'", "x" * 5000, "é" * 300, "CON", "..", "", " ", "\u2028\x85\x0b", "1H,,1H;,\x7f",
)  # fmt: skip

any_text = st.one_of(
    st.sampled_from(TEXTS), st.text(max_size=80),
    st.lists(st.sampled_from(TEXTS), min_size=2, max_size=3).map("".join),
)  # fmt: skip
