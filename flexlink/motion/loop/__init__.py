"""The closed loop of an arm and its controller: poles, growth, margins, and the largest stable gain, rate and delay."""
