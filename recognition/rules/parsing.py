"""From the text of an expression to its tree.

::

    when        = { "each" domain ":" } or
    or          = and { "or" and }
    and         = unary { "and" unary }
    unary       = "not" unary | "(" or ")" | "exists" domain ":" or | count | comparison | use
    count       = "count" "(" domain ":" or ")" ( "<" | "<=" | ">" | ">=" | "==" | "!=" ) number
    comparison  = ( "dist" | "clearance" | "speed" ) "(" places [ "," way ] ")" ( "<" | ">" ) limit [ "exit" limit ]
    use         = name "(" places ")"
    domain      = ( [ class ] name | name "in" "{" class { "," class } "}" ) { "!=" name } [ "of" name ]
    places      = place { "," place }           place = name [ "." name ]           limit = number unit

The condition of ``exists`` and ``each`` goes on as far as it can.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import NamedTuple, NoReturn

from recognition.rules.syntax import (
    Comparison,
    Count,
    Domain,
    Exists,
    Expression,
    Measure,
    Name,
    Not,
    Place,
    Quantity,
    Several,
    Use,
    When,
)
from recognition.rules.vocabulary import MEASURES, RESERVED, WAYS

MOST_DEPTH = 40
"""Of conditions in each other."""
_TOKEN = re.compile(
    r"\s*(?:(?P<word>3d\b|[A-Za-z_]\w*(?:/[A-Za-z]+)?)|(?P<number>\d+(?:\.\d+)?)|(?P<sign><=|>=|==|!=|[<>(){},:.])|"
    r"(?P<end>\Z)|(?P<other>.))",
    re.DOTALL | re.ASCII,
)
_COUNTING = ("<", "<=", ">", ">=", "==", "!=")


class ExpressionError(Exception):
    """A mistake in an expression: at an offset of its text, or of the text of the definition in ``source``."""

    def __init__(
        self, at: int, problem: str, *, expected: str, got: str, do_next: str, source: str | None = None
    ) -> None:
        super().__init__(problem)
        self.source = source
        self.at, self.problem, self.expected, self.got, self.do_next = at, problem, expected, got, do_next


class _Token(NamedTuple):
    kind: str
    text: str
    at: int

    @property
    def end(self) -> int:
        return self.at + len(self.text)

    @property
    def said(self) -> str:
        return repr(self.text) if self.text else "the end of the expression"


def parse_when(text: str) -> When:
    """The tree of what a rule forbids.

    Raises:
        ExpressionError: where the text does not have the form.
    """
    parser = _Parser(text)
    each = []
    while parser.takes("each"):
        each.append(parser.domain())
        parser.expect(":", "a colon after whom `each` speaks about")
    return When(tuple(each), parser.whole())


def parse_condition(text: str) -> Expression:
    """The tree of a definition.

    Raises:
        ExpressionError: where the text does not have the form.
    """
    return _Parser(text).whole()


def parse_head(text: str) -> tuple[Name, tuple[Name, ...]]:
    """Name and variables of a definition: ``climbs(w, l)``.

    Raises:
        ExpressionError: where the text does not have the form.
    """
    parser = _Parser(text)
    name = parser.new_name("a name for the definition")
    parser.expect("(", "a round bracket after the definition's name")
    variables = [parser.new_name("a variable")]
    while parser.takes(","):
        variables.append(parser.new_name("a variable"))
    parser.expect(")", "a closing round bracket")
    parser.expect("", "nothing more")
    return name, tuple(variables)


def _tokens(text: str) -> list[_Token]:
    tokens, at = [], 0
    while True:
        found = _TOKEN.match(text, at)
        kind = str(found.lastgroup) if found else "end"
        token = _Token(kind, found[kind], found.start(kind)) if found else _Token("end", "", len(text))
        if kind == "other":
            raise ExpressionError(
                token.at,
                "a character that rules do not have",
                expected="words, numbers with units, and < > <= >= == != ( ) { } , : .",
                got=repr(token.text),
                do_next="there is no arithmetic: say it with dist(..., xy) or dist(..., z), and with two limits",
            )
        tokens.append(token)
        if kind == "end":
            return tokens
        at = found.end() if found else len(text)


class _Parser:
    """Recursive descent over the tokens of one expression."""

    def __init__(self, text: str) -> None:
        self._text, self._tokens, self._next, self._depth = text, _tokens(text), 0, 0

    def takes(self, text: str) -> bool:
        """Whether the next token is this; if so it is passed."""
        if self._tokens[self._next].text != text:
            return False
        self._next += 1
        return True

    def expect(self, text: str, what: str) -> None:
        """Pass a token that must come."""
        token = self._tokens[self._next]
        if token.text != text:
            self._fail(token, what)
        self._next = min(self._next + 1, len(self._tokens) - 1)

    def new_name(self, what: str) -> Name:
        """A name that somebody chose."""
        name = self._name(what)
        if name.text in RESERVED or "/" in name.text:
            raise ExpressionError(
                name.at,
                "a word of the language cannot be a name",
                expected=what,
                got=repr(name.text),
                do_next="choose another name",
            )
        return name

    def whole(self) -> Expression:
        """The rest, which must be one condition."""
        found = self._either()
        self.expect("", "the end of the expression, `and` or `or`")
        return found

    def domain(self) -> Domain:
        """Whom a quantifier speaks about."""
        first = self.new_name("a variable, or a class and a variable")
        classes: tuple[Name, ...] = ()
        if self.takes("in"):
            variable, classes = first, self._classes()
        elif self._tokens[self._next].kind == "word" and self._tokens[self._next].text not in RESERVED:
            variable, classes = self.new_name("a variable"), (first,)
        else:
            variable = first
        apart = []
        while self.takes("!="):
            apart.append(self._name("a variable"))
        return Domain(variable, classes, tuple(apart), self._name("a worker's variable") if self.takes("of") else None)

    def _classes(self) -> tuple[Name, ...]:
        self.expect("{", "classes in curly brackets, such as {ladder, step_ladder}")
        classes = [self._name("a class")]
        while self.takes(","):
            classes.append(self._name("a class"))
        self.expect("}", "a closing curly bracket")
        return tuple(classes)

    def _either(self) -> Expression:
        return self._several("or", lambda: self._several("and", self._unary))

    def _several(self, word: str, part: Callable[[], Expression]) -> Expression:
        at = self._tokens[self._next].at
        parts = [part()]
        while self.takes(word):
            parts.append(part())
        return parts[0] if len(parts) == 1 else Several(word, tuple(parts), at, self._end)

    def _unary(self) -> Expression:
        self._depth += 1
        token = self._tokens[self._next]
        if self._depth > MOST_DEPTH:
            raise ExpressionError(
                token.at,
                "conditions are too deep in each other",
                expected=f"at most {MOST_DEPTH}",
                got="more",
                do_next="take parts of it out as definitions",
            )
        found = self._single(token)
        self._depth -= 1
        return found

    def _single(self, token: _Token) -> Expression:
        if self.takes("not"):
            body = self._unary()
            return Not(body, token.at, self._end)
        if self.takes("("):
            body = self._either()
            self.expect(")", "a closing round bracket, `and` or `or`")
            return body
        if self.takes("exists"):
            domain = self.domain()
            self.expect(":", "a colon after whom `exists` speaks about")
            body = self._either()
            return Exists(domain, body, token.at, self._end)
        if self.takes("count"):
            return self._count(token)
        if token.text == "each":
            raise ExpressionError(
                token.at,
                "`each` stands only at the beginning of a rule's `when`",
                expected="a condition",
                got="'each'",
                do_next="move it to the beginning, or write `not exists ...: not ...`",
            )
        if token.text in MEASURES:
            return self._comparison(token)
        return self._use(token)

    def _count(self, token: _Token) -> Count:
        self.expect("(", "count(w: ...)")
        domain = self.domain()
        self.expect(":", "a colon after whom `count` speaks about")
        body = self._either()
        self.expect(")", "a closing round bracket, `and` or `or`")
        operator = self._operator(_COUNTING)
        number = self._number()
        return Count(domain, body, operator, Quantity(float(number.text), Name("", number.end), number.at, number.text),
                     token.at, self._end)  # fmt: skip

    def _comparison(self, token: _Token) -> Comparison:
        measure = self._measure()
        operator = self._operator(("<", ">"))
        limit = self._quantity()
        leave = self._quantity() if self.takes("exit") else None
        return Comparison(measure, operator, limit, leave, token.at, self._end)

    def _measure(self) -> Measure:
        name = self._name("a measure")
        self.expect("(", f"{name.text}(...)")
        arguments, way = [self._place()], None
        while self.takes(","):
            token = self._tokens[self._next]
            if token.text in WAYS:
                way = self._name("how it is measured")
                break
            arguments.append(self._place())
        self.expect(")", "a comma or a closing round bracket")
        return Measure(name, tuple(arguments), way, name.at, self._end)

    def _use(self, token: _Token) -> Use:
        name = self._name("a condition")
        if name.text in RESERVED and self._tokens[self._next].text != "(":
            self._fail(token, "a condition")
        self.expect("(", f"arguments in round brackets: {name.text}(...)")
        arguments = [self._place()]
        while self.takes(","):
            arguments.append(self._place())
        self.expect(")", "a comma or a closing round bracket")
        return Use(name, tuple(arguments), token.at, self._end)

    def _place(self) -> Place:
        base = self._name("a variable, such as w.head, or a zone")
        return Place(base, self._name("a point or a part") if self.takes(".") else None)

    def _operator(self, known: tuple[str, ...]) -> str:
        token = self._tokens[self._next]
        if token.text not in known:
            self._fail(token, f"a comparison: one of {' '.join(known)}")
        self._next += 1
        return token.text

    def _number(self) -> _Token:
        token = self._tokens[self._next]
        if token.kind != "number":
            self._fail(token, "a number")
        self._next += 1
        return token

    def _quantity(self) -> Quantity:
        number = self._number()
        token = self._tokens[self._next]
        if token.kind != "word" or token.text in ("and", "or", "exit"):
            raise ExpressionError(
                number.end,
                "a limit without a unit",
                expected="a unit: m, cm, mm, H (the height of the worker), m/s or km/h",
                got=number.said,
                do_next=f"write {number.text} m, or what is meant",
            )
        unit = self._name("a unit")
        return Quantity(float(number.text), unit, number.at, self._text[number.at : self._end])

    def _name(self, what: str) -> Name:
        token = self._tokens[self._next]
        if token.kind != "word":
            self._fail(token, what)
        self._next += 1
        return Name(token.text, token.at)

    @property
    def _end(self) -> int:
        return self._tokens[self._next - 1].end

    def _fail(self, token: _Token, what: str) -> NoReturn:
        raise ExpressionError(
            token.at,
            "the expression does not go on so",
            expected=what,
            got=token.said,
            do_next="the grammar is in recognition.rules.parsing; brackets and colons are missed most often",
        )
