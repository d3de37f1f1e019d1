"""Questions about a scene, with answers computed from the boxes, colours, states and rooms of its objects.

The generator asks only what its answer makes plain: a description must denote the same objects in the strict sense
and in the most lenient one (other words for a category, unnamed colours, borderline relations). Forms, `X`, `A` and
`B` being descriptions as below; each has three wordings or more unless listed whole:

- object recognition: "What is on | in | under | behind | above | next to the X?", "What is the red object on the X?".
  Answer: "A lamp", "A cup and two books".
- object localization: "Where is the X?", "Have you seen the X?". Answer: "On the bed in the bedroom", with
  `extra_answers` such as "On the bed" or "Next to the lamp".
- attribute recognition: "What color is the X?", "Is the X red or blue?", "Which is taller, the A or the B?",
  "Which is bigger, the A or the B?". Answer: "Red", "The A".
- spatial understanding: "Which is closer to the X, the A or the B?", "Is the A to the left or to the right of the X,
  when facing the X?", "If I stand at the P and look at the Q, is the X on my left or on my right?", "How many chairs
  are there in the kitchen?", "What is between the A and the B?", "Is the A above or below the B?", "Is the A in the
  same room as the B?". Answer: "The A", "To the left", "On the right", "4", "A lamp", "Above", "Yes".
- object state recognition: "Is the X open or closed?", "Is the X turned on?", "Is there anything on | under the X?",
  "Is the X clear of things?". Answer: "Open", "Off", "Yes", "No".
- functional reasoning: "Where can I wash my hands?", "What can I sit on in the office?", "Can I take a nap in the
  kitchen?". Answer: "At the sink in the kitchen", "The chair or the couch", "No".
- world knowledge: "Which object would I use to heat up leftovers?", "My hands are dirty. What should I use?", "Is there
  something to read in the office?", "In which room would I sleep at night?". Answer: "The microwave", "Yes, the book
  on the desk", "The bedroom".
- single-target: "Find the X", "This is a red chair. It is next to the bed", "A lamp that is on the desk".
- multi-target: "The black chairs around the table", "Both pillows", "All of the cups on the counter".
- zero-target: as single-target, of something that is not there.
- referring: "Which chair is next to the bed?", "Which of the lamps is closest to the window?", "What is the tallest
  cabinet in the kitchen?", "Which stool stands between the A and the B?", "Can you show me the red chair?".

A description is a category with, at need, a colour before it and a room or a place after it: "red chair", "lamp in the
kitchen", "black trash can under the desk", "pillow closest to the window"; the thing it is placed by may be described
by colour and room in turn: "cup on the brown desk in the office".
"""

from pipeline.scene.questions.generate import EQA_MAKERS, GROUNDING_MAKERS, generate_questions
from pipeline.scene.questions.world import Room

__all__ = ["EQA_MAKERS", "GROUNDING_MAKERS", "Room", "generate_questions"]
