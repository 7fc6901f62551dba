# adaptctl with all that is locked, every package by its hash: docker build -t adaptctl .
FROM python:3.12-slim
WORKDIR /adaptctl
COPY requirements.lock ./
RUN pip install --no-cache-dir --require-hashes --no-deps --only-binary :all: -r requirements.lock
COPY . .
RUN pip install --no-cache-dir --no-deps --no-build-isolation .
RUN useradd --create-home adaptctl
USER adaptctl
WORKDIR /home/adaptctl
ENTRYPOINT ["adaptctl"]
CMD ["doctor"]
